"""`symgrasp export-coco`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ExportCocoConfig
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import CameraName, DatasetSplit, Seed
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "export-coco", named_as("categories", "min_pixels", "frame_stride", "val_fraction", "link")
)
def export_coco(
    config: ExportCocoConfig,
    root: Annotated[
        Path, typer.Argument(exists=True, help="Dataset root with scenes/ and symmetry/.")
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder for annotations/, images/ and scenes/.")],
    split: DatasetSplit = "train",
    camera: CameraName = None,
    options: Batch,
    seed: Seed = 0,
) -> None:
    """Export the masks of symmetric regions as a COCO instance dataset."""
    from pipelines import export_coco as stage

    report = stage.run(root, out, config, split=split, camera=camera, seed=seed, options=options)
    conclude(report, out, then=("finetune-detector", out, "--out", "detector.safetensors"))
