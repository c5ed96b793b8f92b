"""Options that several commands share, and how they become `BatchOptions`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pipelines.runtime.batch import BatchOptions

Workers = Annotated[int, typer.Option(min=1, help="Processes that work at a time.")]
Backend = Annotated[
    str, typer.Option(help="joblib's backend: loky, or dask or ray with that extra installed.")
]
Seed = Annotated[
    int, typer.Option(min=0, max=2**63 - 1, help="Seed of everything that is drawn at random.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Make outputs again that exist.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what would be done, do nothing.")]
Device = Annotated[
    str, typer.Option(help="auto, cpu, cuda or cuda:N; auto takes a GPU if there is one.")
]
DatasetSplit = Annotated[
    str, typer.Option(help="Scenes to take: train, seen, similar, novel or all.")
]
CameraName = Annotated[
    str | None, typer.Option(help="kinect or realsense; every camera if not given.")
]
DatasetRoot = Annotated[
    Path,
    typer.Option(exists=True, file_okay=False, help="Root of the dataset, GraspNet's layout."),
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with an unfinished training.")]
FrameFolder = Annotated[
    Path,
    typer.Argument(
        exists=True,
        help="Folder of RGB-D frames in any layout that the docs list, or one frame's file.",
    ),
]
IntrinsicsText = Annotated[
    str | None, typer.Option(help="fx,fy,cx,cy in pixels, or a camera file, for all frames.")
]
DepthUnitsPerMetre = Annotated[
    float | None, typer.Option(help="What depth values are divided by to give metres.")
]
Threads = Annotated[int, typer.Option(min=1, help="CPU cores to train on.")]
TimeLimit = Annotated[
    float | None,
    typer.Option(min=0.0, help="Minutes after which to stop cleanly; --resume goes on."),
]

Precision = Annotated[
    str, typer.Option(help="Of the large products of a training step: float32, or bf16 for GPUs.")
]
Compile = Annotated[
    bool, typer.Option("--compile", help="Compile chains of layers, for GPUs; slow to start.")
]


def batch_options(workers: int, backend: str, *, overwrite: bool, dry_run: bool) -> BatchOptions:
    """Return the options of a batch, the progress bar shown where stderr is a terminal.

    More workers than cores only take each other's memory: there are as many as cores then.

    Raises:
        UnknownNameError: no such backend.
    """
    import logging
    import sys

    from joblib import cpu_count

    from pipelines.runtime.batch import BatchOptions
    from pipelines.runtime.clusters import check_backend

    check_backend(backend)
    cores = cpu_count()
    if backend == "loky" and workers > cores:
        told = "--workers %d is more than this machine's %d cores: %d work at a time"
        logging.getLogger(__name__).warning(told, workers, cores, cores)
        workers = cores
    return BatchOptions(
        workers=workers,
        backend=backend,
        overwrite=overwrite,
        dry_run=dry_run,
        progress=sys.stderr.isatty(),
    )


def scenes_of(split: str) -> str | None:
    """Return the split that a stage is asked for by `DatasetSplit`; None is all of them."""
    return None if split == "all" else split


def show_training() -> bool:
    """Return whether stderr is a terminal, for a progress bar; else let log lines reach it."""
    import logging
    import sys

    logging.getLogger("pipelines.learning").setLevel(logging.INFO)
    return sys.stderr.isatty()
