"""`symgrasp pack`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import PackConfig
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import CameraName, DatasetSplit, Seed
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import with_settings


@with_settings(
    "pack", {"--frame-stride": "frame_stride", "--mask-noise/--exact-masks": "mask_noise"}
)
def pack(
    config: PackConfig,
    root: Annotated[
        Path,
        typer.Argument(exists=True, help="Dataset root with scenes/, symmetry/ and affordance/."),
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder for scene_NNNN_CAMERA.h5.")],
    split: DatasetSplit = "train",
    camera: CameraName = None,
    options: Batch,
    seed: Seed = 0,
) -> None:
    """Cut frames into region point clouds with labels for training."""
    from pipelines import pack as stage

    report = stage.run(root, out, config, split=split, camera=camera, seed=seed, options=options)
    conclude(report, out, then=("train", out, "--out", "network.safetensors"))
