"""`symgrasp train`."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import TrainConfig
from symgrasp_cli.arguments import DeviceRun
from symgrasp_cli.options import StartWeights, WeightsToWrite
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings(
    "train",
    {
        "--endless-share": "endless.share",
        "--epoch-regions": "endless.epoch_regions",
        **named_as("epochs", "batch_size", "learning_rate", "decay_epochs"),
        "--pift/--no-pift": "network.use_pift",
        "--canonical-frame/--no-canonical-frame": "network.canonical_frame",
        "--siamese/--no-siamese": "use_siamese",
        "--micro-batch": "micro_batch_size",
    },
)
def train(
    config: TrainConfig,
    *,
    out: WeightsToWrite,
    packed: Annotated[
        Path | None,
        typer.Argument(
            exists=True,
            file_okay=False,
            help="Folder of packed regions, from `pack`; not needed with --endless and --val.",
        ),
    ] = None,
    endless: Annotated[
        list[Path] | None,
        typer.Option(
            exists=True,
            help="Dataset root with symmetry/ and affordance/: fresh regions of its objects; may "
            "be given again.",
        ),
    ] = None,
    val: Annotated[
        Path | None,
        typer.Option(
            exists=True,
            help="Packed regions to validate on; by default a tenth of PACKED's scenes.",
        ),
    ] = None,
    init: StartWeights = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Processes that render the regions of --endless.")
    ] = 1,
    request: DeviceRun,
) -> None:
    """Train the symmetry-aware grasp network on packed regions."""
    from pipelines import train as stage

    if packed is None and not endless:
        raise typer.BadParameter("give PACKED, --endless ROOT, or both")
    if workers > 1 and not endless:
        raise typer.BadParameter(f"--workers {workers} goes with --endless ROOT")
    share = _rendered_share(config.endless.share, packed, endless)
    config = replace(config, endless=replace(config.endless, share=share))
    report = stage.run(
        packed, val, out, config, request, endless=endless or (), init=init, workers=workers
    )
    conclude(report, out, then=("infer", "FRAMES", "--network", out))


def _rendered_share(share: float, packed: Path | None, endless: list[Path] | None) -> float:
    """Return the share of rendered regions; `share` is the setting, 0 for the usual one."""
    if share > 0.0 and not endless:
        raise typer.BadParameter(f"--endless-share {share:g} goes with --endless ROOT")
    if packed is None and 0.0 < share < 1.0:
        raise typer.BadParameter(
            f"--endless-share {share:g} goes with PACKED; without it, all regions are rendered"
        )
    if not endless:
        return 0.0
    return 1.0 if packed is None else share or 0.5
