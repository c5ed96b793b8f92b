"""`symgrasp train`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import EndlessConfig, NetworkConfig, TrainConfig
from symgrasp_cli.options import (
    Compile,
    Device,
    MicroBatch,
    Overwrite,
    Precision,
    Resume,
    Seed,
    Threads,
    TimeLimit,
    show_training,
)
from symgrasp_cli.report import conclude


def train(
    out: Annotated[Path, typer.Option(help="Weights to write, NAME.safetensors.")],
    packed: Annotated[
        Path | None,
        typer.Argument(
            exists=True,
            file_okay=False,
            help="Folder of packed regions, from `pack`; with --endless and --val not needed.",
        ),
    ] = None,
    endless: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            help="Dataset root with symmetry/ and affordance/: fresh regions of its objects.",
        ),
    ] = None,
    endless_share: Annotated[
        float,
        typer.Option(min=0.0, max=1.0, help="Of a batch, with --endless beside packed regions."),
    ] = 0.5,
    epoch_regions: Annotated[
        int, typer.Option(min=1, help="That make an epoch where all are fresh.")
    ] = EndlessConfig.epoch_regions,
    val: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            help="Packed regions to validate on; by default a tenth of PACKED's scenes.",
        ),
    ] = None,
    init: Annotated[
        Path | None, typer.Option(exists=True, help="Weights of an earlier training to start from.")
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
    canonical_frame: Annotated[
        bool, typer.Option(help="See points, and tell symmetries, in PIFT's frame.")
    ] = True,
    siamese: Annotated[
        bool, typer.Option(help="Ask for the same features in a scaled copy (Fig. 3).")
    ] = True,
    micro_batch: MicroBatch = 0,
    time_limit: TimeLimit = None,
    threads: Threads = 2,
    device: Device = "auto",
    workers: Annotated[
        int, typer.Option(min=1, help="Processes that render the regions of --endless.")
    ] = 1,
    precision: Precision = "float32",
    compiled: Compile = False,
    seed: Seed = 0,
    resume: Resume = False,
    overwrite: Overwrite = False,
) -> None:
    """Train the symmetry-aware grasp network on packed regions."""
    from pipelines import train as stage
    from pipelines.learning.loop.runs import RunRequest

    share = 0.0 if endless is None else 1.0 if packed is None else endless_share
    config = TrainConfig(
        network=NetworkConfig(use_pift=pift, canonical_frame=canonical_frame),
        epochs=epochs,
        batch_size=batch_size,
        micro_batch_size=micro_batch,
        learning_rate=learning_rate,
        decay_epochs=decay_epochs,
        use_siamese=siamese,
        endless=EndlessConfig(share=share, epoch_regions=epoch_regions),
    )
    bar = show_training()
    if packed is None and endless is None:
        raise typer.BadParameter("give PACKED, --endless ROOT, or both")
    request = RunRequest(
        seed, device, threads, time_limit, resume, overwrite, bar, precision, compiled
    )
    report = stage.run(
        packed, val, out, config, request, endless=endless, init=init, workers=workers
    )
    conclude(report)
