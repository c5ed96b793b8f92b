"""`symgrasp finetune-detector`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import FinetuneDetectorConfig
from symgrasp_cli.arguments import LoadedRun, Preparation
from symgrasp_cli.options import CameraName, DatasetSplit, StartWeights, WeightsToWrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "finetune-detector",
    {
        **named_as("detector.variant", "detector.input"),
        **named_as("frame_stride", "epochs", "batch_size", "learning_rate", "decay_epochs"),
        "--micro-batch": "micro_batch_size",
    },
)
def finetune_detector(
    config: FinetuneDetectorConfig,
    roots: Annotated[
        list[Path],
        typer.Argument(
            exists=True, help="Dataset roots with scenes/ and symmetry/, or outputs of export-coco."
        ),
    ],
    *,
    out: WeightsToWrite,
    split: DatasetSplit = "train",
    camera: CameraName = None,
    coco_weights: Annotated[
        str | None,
        typer.Option(help="Start weights of resnet50: a file of torchvision, or download."),
    ] = None,
    init: StartWeights = None,
    request: LoadedRun,
    options: Preparation,
) -> None:
    """Train the detector of symmetric regions on the frames of datasets."""
    from pipelines import finetune_detector as stage

    report = stage.run(
        roots,
        out,
        config,
        request,
        split=split,
        camera=camera,
        coco_weights=coco_weights,
        init=init,
        options=options,
    )
    conclude(report, out, then=("infer", "FRAMES", "--detector", out))
