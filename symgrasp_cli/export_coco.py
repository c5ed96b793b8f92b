"""`symgrasp export-coco`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import ExportCocoConfig
from symgrasp_cli.options import (
    Backend,
    CameraName,
    DatasetSplit,
    DryRun,
    FrameStride,
    Overwrite,
    Seed,
    Workers,
    batch_options,
    scenes_of,
)
from symgrasp_cli.report import conclude


def export_coco(
    root: Annotated[
        Path, typer.Argument(exists=True, help="Dataset root with scenes/ and symmetry/.")
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder for annotations/, images/ and scenes/.")],
    split: DatasetSplit = "train",
    camera: CameraName = None,
    categories: Annotated[
        str, typer.Option(help="By what regions are told apart: kind, object, or region for one.")
    ] = ExportCocoConfig.categories,
    min_pixels: Annotated[
        int, typer.Option(min=1, help="Regions that show in fewer pixels are left out.")
    ] = ExportCocoConfig.min_pixels,
    frame_stride: FrameStride = ExportCocoConfig.frame_stride,
    val_fraction: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Share of the scenes to validate on; 0: none.")
    ] = ExportCocoConfig.val_fraction,
    link: Annotated[
        bool, typer.Option("--link", help="Link to the dataset's images instead of copying them.")
    ] = ExportCocoConfig.link,
    workers: Workers = 1,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Export the masks of symmetric regions as a COCO instance dataset."""
    from pipelines import export_coco as stage

    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    config = ExportCocoConfig(categories, min_pixels, frame_stride, val_fraction, link)
    report = stage.run(
        root, out, config, split=scenes_of(split), camera=camera, seed=seed, options=options
    )
    conclude(report)
