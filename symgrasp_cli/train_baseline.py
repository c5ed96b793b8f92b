"""`symgrasp train-baseline`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import TrainBaselineConfig
from pipelines.configs.inference import TRAINED_METHODS
from symgrasp_cli.options import (
    Backend,
    CameraName,
    Compile,
    DatasetSplit,
    Device,
    Loaders,
    MaxSeconds,
    Overwrite,
    Precision,
    Resume,
    Seed,
    Threads,
    Workers,
    batch_options,
    show_training,
    split_or_all,
)
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import with_settings


@with_settings(
    "train-baseline",
    {
        "--variant": "network.variant",
        "--steps": "steps",
        "--batch-size": "batch_size",
        "--learning-rate": "learning_rate",
        "--decay-steps": "decay_steps",
        "--micro-batch": "micro_batch_size",
        "--frame-stride": "frame_stride",
    },
)
def train_baseline(
    config: TrainBaselineConfig,
    method: Annotated[
        str, typer.Argument(help=f"A compared method: {', '.join(TRAINED_METHODS)}.")
    ],
    root: Annotated[
        Path,
        typer.Argument(
            exists=True,
            file_okay=False,
            help="Dataset root with the labels that the method needs: of `synthesize OUT "
            "--collision-labels`, or GraspNet-1Billion; for symmetrynet of `annotate-symmetry`.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Weights to write, NAME.safetensors.")],
    split: DatasetSplit = "train",
    camera: CameraName = None,
    max_seconds: MaxSeconds = None,
    threads: Threads = 2,
    device: Device = "auto",
    workers: Workers = None,
    backend: Backend = "loky",
    precision: Precision = "float32",
    compiled: Compile = False,
    loaders: Loaders = 0,
    seed: Seed = 0,
    resume: Resume = False,
    overwrite: Overwrite = False,
) -> None:
    """Train a method that the paper compares with, on a dataset of its labels."""
    from pipelines import train_baseline as stage
    from pipelines.learning.loop.runs import RunRequest

    bar = show_training()
    request = RunRequest(
        seed, device, threads, max_seconds, resume, overwrite, bar, precision, compiled, loaders
    )
    options = batch_options(workers, backend, overwrite=overwrite, dry_run=False)
    report = stage.run(
        method,
        root,
        out,
        config,
        request,
        split=split_or_all(split),
        camera=camera,
        options=options,
    )
    conclude(report, out, then=("infer", "FRAMES", "--method", method, "--weights", out))
