"""`symgrasp pack`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import PackConfig
from symgrasp_cli.options import Backend, DryRun, Overwrite, Seed, Workers, batch_options
from symgrasp_cli.report import conclude


def pack(
    root: Annotated[
        Path, typer.Argument(help="Dataset root with scenes/, symmetry/ and affordance/.")
    ],
    *,
    out: Annotated[Path, typer.Option(help="Folder for scene_NNNN_CAMERA.h5.")],
    split: Annotated[
        str, typer.Option(help="Scenes to pack: train, seen, similar, novel or all.")
    ] = "train",
    camera: Annotated[
        str | None, typer.Option(help="kinect or realsense; every camera if not given.")
    ] = None,
    frame_stride: Annotated[
        int, typer.Option(min=1, help="Pack every n-th frame of a scene.")
    ] = PackConfig.frame_stride,
    mask_noise: Annotated[
        bool,
        typer.Option(
            "--mask-noise/--exact-masks",
            help="Disturb the masks as a detector would, or take them as labelled.",
        ),
    ] = PackConfig.mask_noise,
    workers: Workers = 1,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Cut frames into region point clouds with labels for training."""
    from pipelines import pack as stage

    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    config = PackConfig(frame_stride=frame_stride, mask_noise=mask_noise)
    wanted = None if split == "all" else split
    report = stage.run(root, out, config, split=wanted, camera=camera, seed=seed, options=options)
    conclude(report)
