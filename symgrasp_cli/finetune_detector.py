"""`symgrasp finetune-detector`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import FinetuneDetectorConfig
from symgrasp_cli.options import (
    Backend,
    CameraName,
    Compile,
    DatasetSplit,
    Device,
    Loaders,
    MaxMinutes,
    MaxSeconds,
    Overwrite,
    Precision,
    Resume,
    Seed,
    Threads,
    Workers,
    batch_options,
    seconds_allowed,
    show_training,
    split_or_all,
)
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import with_settings


@with_settings(
    "finetune-detector",
    {
        "--variant": "detector.variant",
        "--input": "detector.input",
        "--epochs": "epochs",
        "--batch-size": "batch_size",
        "--learning-rate": "learning_rate",
        "--decay-epochs": "decay_epochs",
        "--micro-batch": "micro_batch_size",
    },
)
def finetune_detector(
    config: FinetuneDetectorConfig,
    roots: Annotated[
        list[Path],
        typer.Argument(
            exists=True, help="Dataset roots with scenes/ and symmetry/, or what export-coco wrote."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Weights to write, NAME.safetensors.")],
    split: DatasetSplit = "train",
    camera: CameraName = None,
    coco_weights: Annotated[
        str | None,
        typer.Option(help="Start of resnet50: a file of torchvision's weights, or download."),
    ] = None,
    init: Annotated[
        Path | None, typer.Option(exists=True, help="Weights of an earlier training to start from.")
    ] = None,
    max_seconds: MaxSeconds = None,
    max_minutes: MaxMinutes = None,
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
    """Train the detector of symmetric regions on the frames of datasets."""
    from pipelines import finetune_detector as stage
    from pipelines.learning.loop.runs import RunRequest

    bar = show_training()
    limit = seconds_allowed(max_seconds, max_minutes)
    request = RunRequest(
        seed, device, threads, limit, resume, overwrite, bar, precision, compiled, loaders
    )
    options = batch_options(workers, backend, overwrite=overwrite, dry_run=False)
    report = stage.run(
        roots,
        out,
        config,
        request,
        split=split_or_all(split),
        camera=camera,
        coco_weights=coco_weights,
        init=init,
        options=options,
    )
    conclude(report, out, then=("infer", "FRAMES", "--detector", out))
