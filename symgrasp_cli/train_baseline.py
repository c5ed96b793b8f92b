"""`symgrasp train-baseline`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import TrainBaselineConfig
from pipelines.configs.inference import TRAINED_METHODS
from symgrasp_cli.arguments import LoadedRun, Preparation
from symgrasp_cli.options import CameraName, DatasetSplit, WeightsToWrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "train-baseline",
    {
        **named_as("network.variant", "steps", "batch_size", "learning_rate", "decay_steps"),
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
    *,
    out: WeightsToWrite,
    split: DatasetSplit = "train",
    camera: CameraName = None,
    request: LoadedRun,
    options: Preparation,
) -> None:
    """Train a method that the paper compares with, on a dataset with its labels."""
    from pipelines import train_baseline as stage

    report = stage.run(
        method, root, out, config, request, split=split, camera=camera, options=options
    )
    conclude(report, out, then=("infer", "FRAMES", "--method", method, "--weights", out))
