"""`symgrasp simulate`."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import SimulateConfig
from pipelines.configs.settings import settings_of
from symgrasp_cli.arguments import Batch
from symgrasp_cli.options import DatasetRoot, Seed, With
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings("simulate", {"--friction": "frictions", **named_as("gripper", "min_visible_pixels")})
def simulate(
    config: SimulateConfig,
    grasps: Annotated[
        Path,
        typer.Argument(exists=True, dir_okay=False, help="grasps.h5 of `infer` on the dataset."),
    ],
    *,
    dataset: DatasetRoot,
    out: Annotated[Path, typer.Option(help="Rates to write; trials go next to it.")] = (
        Path("success.json")
    ),
    with_: With = None,
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines",
            help="Also try oracle, planar-critic, planar and random on the same regions.",
        ),
    ] = False,
    options: Batch,
    seed: Seed = 0,
) -> None:
    """Try the grasps in simulation: approach, close, lift, five tugs; success by symmetry."""
    from pipelines import simulate as stage

    if not config.frictions:
        raise typer.BadParameter(
            "no number is given; give some, as 0.3,0.5,0.8", param_hint="--friction"
        )
    config = replace(config, frictions=tuple(sorted(set(config.frictions))))
    report = stage.run(
        grasps, dataset, out, config, options, others=with_ or (), baselines=baselines, seed=seed
    )
    shared = shared_options(config)
    then: list[str | Path] = ["evaluate", grasps, "--dataset", dataset, *shared, "--success", out]
    written = not options.dry_run and out.exists() and bool(report.done or report.skipped)
    conclude(report, out, then=then, tables=stage.tables(out) if written else ())


def shared_options(config: SimulateConfig) -> tuple[str, ...]:
    """Return the options that `evaluate` must have too, or it refuses the rates."""
    from pipelines.evaluation.reports.reports import WHICH_OBJECTS

    names = ("gripper", *WHICH_OBJECTS)
    changed = [s for s in settings_of(config) if s.name in names and s.value != s.default]
    return tuple(word for each in changed for word in ("--set", f"{each.name}={each.value}"))
