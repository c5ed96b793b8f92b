"""`symgrasp train`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import NetworkConfig, TrainConfig
from symgrasp_cli.options import (
    Device,
    MicroBatch,
    Overwrite,
    Resume,
    Seed,
    Threads,
    TimeLimit,
    show_training,
)
from symgrasp_cli.report import conclude


def train(
    packed: Annotated[Path, typer.Argument(help="Folder of packed regions, from `pack`.")],
    out: Annotated[Path, typer.Option(help="Weights to write, NAME.safetensors.")],
    val: Annotated[
        Path | None,
        typer.Option(help="Packed regions to validate on; by default a tenth of the scenes."),
    ] = None,
    init: Annotated[
        Path | None, typer.Option(help="Weights of an earlier training to start from.")
    ] = None,
    epochs: Annotated[
        int, typer.Option(min=1, help="Passes over the regions.")
    ] = TrainConfig.epochs,
    batch_size: Annotated[
        int, typer.Option(min=1, help="Regions a step.")
    ] = TrainConfig.batch_size,
    learning_rate: Annotated[
        float, typer.Option(min=0.0, help="Of Adam, at first.")
    ] = TrainConfig.learning_rate,
    decay_epochs: Annotated[
        float, typer.Option(min=0.01, help="Epochs after which the rate drops by a tenth.")
    ] = TrainConfig.decay_epochs,
    pift: Annotated[bool, typer.Option(help="Deform points before aggregation (Eq. 3).")] = True,
    siamese: Annotated[
        bool, typer.Option(help="Ask for the same features in a scaled copy (Fig. 3).")
    ] = True,
    micro_batch: MicroBatch = 0,
    time_limit: TimeLimit = None,
    threads: Threads = 2,
    device: Device = "auto",
    seed: Seed = 0,
    resume: Resume = False,
    overwrite: Overwrite = False,
) -> None:
    """Train the symmetry-aware grasp network on packed regions."""
    from pipelines import train as stage
    from pipelines.learning.runs import RunRequest

    config = TrainConfig(
        network=NetworkConfig(use_pift=pift),
        epochs=epochs,
        batch_size=batch_size,
        micro_batch_size=micro_batch,
        learning_rate=learning_rate,
        decay_epochs=decay_epochs,
        use_siamese=siamese,
    )
    bar = show_training()
    request = RunRequest(seed, device, threads, time_limit, resume, overwrite, bar)
    conclude(stage.run(packed, val, out, config, request, init=init))
