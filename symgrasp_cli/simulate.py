"""`symgrasp simulate`."""

import math
from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import SimulateConfig
from symgrasp_cli.options import (
    Backend,
    DatasetRoot,
    DryRun,
    GripperUsed,
    MinVisiblePixels,
    Overwrite,
    Seed,
    Workers,
    batch_options,
)
from symgrasp_cli.report import conclude, show_table

DEFAULTS = SimulateConfig()
FRICTIONS = ",".join(f"{friction:g}" for friction in DEFAULTS.frictions)


def simulate(
    grasps: Annotated[
        Path,
        typer.Argument(exists=True, dir_okay=False, help="grasps.h5 of `infer` on the dataset."),
    ],
    *,
    dataset: DatasetRoot,
    out: Annotated[Path, typer.Option(help="Rates to write; trials go beside it.")] = (
        Path("success.json")
    ),
    friction: Annotated[
        str,
        typer.Option(metavar="MU,...", help="Frictions of fingers and objects, each one a trial."),
    ] = FRICTIONS,
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines",
            help="Also try what `evaluate --baselines` judges: ground truth, boundary, chance.",
        ),
    ] = False,
    gripper: GripperUsed = DEFAULTS.gripper,
    min_visible_pixels: MinVisiblePixels = DEFAULTS.min_visible_pixels,
    workers: Workers = 1,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Try the grasps in physics: approach, close, lift, five tugs; success by symmetry."""
    from pipelines import simulate as stage

    config = SimulateConfig(
        frictions=parse_frictions(friction), gripper=gripper, min_visible_pixels=min_visible_pixels
    )
    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    report = stage.run(grasps, dataset, out, config, options, baselines=baselines, seed=seed)
    if not dry_run:
        for table in stage.tables(out):
            show_table(table)
    conclude(report)


def parse_frictions(text: str) -> tuple[float, ...]:
    """Return the different positive numbers of `text`, ascending."""
    try:
        frictions = sorted({float(part) for part in text.split(",")})
    except ValueError as error:
        raise typer.BadParameter(f"--friction is {text}; numbers with commas go there") from error
    if not all(math.isfinite(friction) and friction > 0.0 for friction in frictions):
        raise typer.BadParameter(f"--friction is {text}; frictions are above 0")
    return tuple(frictions)
