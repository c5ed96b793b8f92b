"""`symgrasp finetune-detector`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import DetectorConfig, FinetuneDetectorConfig
from symgrasp_cli.options import (
    Backend,
    Compile,
    Device,
    MicroBatch,
    Overwrite,
    Precision,
    Resume,
    Seed,
    Threads,
    TimeLimit,
    Workers,
    batch_options,
    show_training,
)
from symgrasp_cli.report import conclude


def finetune_detector(
    roots: Annotated[
        list[Path],
        typer.Argument(
            exists=True, help="Dataset roots with scenes/ and symmetry/, or what export-coco wrote."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Weights to write, NAME.safetensors.")],
    split: Annotated[
        str, typer.Option(help="Scenes to use: train, seen, similar, novel or all.")
    ] = ("train"),
    camera: Annotated[
        str | None, typer.Option(help="kinect or realsense; by default all that are there.")
    ] = None,
    variant: Annotated[
        str, typer.Option(help="light, or resnet50 as in the paper.")
    ] = DetectorConfig.variant,
    input_kind: Annotated[
        str, typer.Option("--input", help="What it is shown: geometry, color or both.")
    ] = DetectorConfig.input,
    coco_weights: Annotated[
        str | None,
        typer.Option(help="Start of resnet50: a file of torchvision's weights, or download."),
    ] = None,
    init: Annotated[
        Path | None, typer.Option(exists=True, help="Weights of an earlier training to start from.")
    ] = None,
    epochs: Annotated[
        int, typer.Option(min=1, help="Passes over the frames.")
    ] = FinetuneDetectorConfig.epochs,
    batch_size: Annotated[
        int, typer.Option(min=1, help="Frames a step.")
    ] = FinetuneDetectorConfig.batch_size,
    learning_rate: Annotated[
        float, typer.Option(min=0.0, help="Of Adam, at first.")
    ] = FinetuneDetectorConfig.learning_rate,
    decay_epochs: Annotated[
        float, typer.Option(min=0.01, help="Epochs after which the rate drops by a tenth.")
    ] = FinetuneDetectorConfig.decay_epochs,
    micro_batch: MicroBatch = 0,
    time_limit: TimeLimit = None,
    threads: Threads = 2,
    device: Device = "auto",
    workers: Workers = 1,
    backend: Backend = "loky",
    precision: Precision = "float32",
    compiled: Compile = False,
    seed: Seed = 0,
    resume: Resume = False,
    overwrite: Overwrite = False,
) -> None:
    """Train the detector of symmetric regions on the frames of datasets."""
    from pipelines import finetune_detector as stage
    from pipelines.learning.loop.runs import RunRequest

    config = FinetuneDetectorConfig(
        detector=DetectorConfig(variant=variant, input=input_kind),
        epochs=epochs,
        batch_size=batch_size,
        micro_batch_size=micro_batch,
        learning_rate=learning_rate,
        decay_epochs=decay_epochs,
    )
    bar = show_training()
    request = RunRequest(
        seed, device, threads, time_limit, resume, overwrite, bar, precision, compiled
    )
    options = batch_options(workers, backend, overwrite=overwrite, dry_run=False)
    report = stage.run(
        roots,
        out,
        config,
        request,
        split=None if split == "all" else split,
        camera=camera,
        coco_weights=coco_weights,
        init=init,
        options=options,
    )
    conclude(report)
