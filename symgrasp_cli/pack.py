"""`symgrasp pack`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import PackConfig
from symgrasp_cli.options import (
    Backend,
    CameraName,
    DatasetSplit,
    DryRun,
    Overwrite,
    Seed,
    Workers,
    batch_options,
    split_or_all,
)
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import with_settings


@with_settings(
    "pack",
    {"--frame-stride": "frame_stride", "--mask-noise/--exact-masks": "mask_noise"},
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
    workers: Workers = None,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Cut frames into region point clouds with labels for training."""
    from pipelines import pack as stage

    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    report = stage.run(
        root, out, config, split=split_or_all(split), camera=camera, seed=seed, options=options
    )
    conclude(report, out, then=("train", out, "--out", "network.safetensors"))
