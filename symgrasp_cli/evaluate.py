"""`symgrasp evaluate`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import EvaluateConfig
from symgrasp_cli.options import Backend, DryRun, Overwrite, Seed, Workers, batch_options
from symgrasp_cli.report import conclude, show_table


def evaluate(
    grasps: Annotated[
        Path,
        typer.Argument(exists=True, dir_okay=False, help="grasps.h5 of `infer` on the dataset."),
    ],
    *,
    dataset: Annotated[
        Path,
        typer.Option(exists=True, file_okay=False, help="Root of the dataset, GraspNet's layout."),
    ],
    out: Annotated[Path, typer.Option(help="Report to write; beside it goes a page, .html.")] = (
        Path("report.json")
    ),
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines",
            help="Also plan on the same regions with ground truth, from the boundary, at random.",
        ),
    ] = False,
    success: Annotated[
        Path | None,
        typer.Option(exists=True, dir_okay=False, help="success.json of `simulate`: Table III."),
    ] = None,
    gripper: Annotated[
        str, typer.Option(help="Gripper preset or TOML file; by default the one of the grasps.")
    ] = EvaluateConfig.gripper,
    min_visible_pixels: Annotated[
        int, typer.Option(min=1, help="Objects with fewer visible pixels do not count.")
    ] = EvaluateConfig.min_visible_pixels,
    workers: Workers = 1,
    backend: Backend = "loky",
    seed: Seed = 0,
    overwrite: Overwrite = False,
    dry_run: DryRun = False,
) -> None:
    """Judge grasps, symmetries and masks against a dataset: report, tables, baselines."""
    from pipelines import evaluate as stage

    config = EvaluateConfig(gripper=gripper, min_visible_pixels=min_visible_pixels)
    options = batch_options(workers, backend, overwrite=overwrite, dry_run=dry_run)
    report = stage.run(
        grasps, dataset, out, config, options, baselines=baselines, success=success, seed=seed
    )
    if not dry_run:
        for table in stage.tables(out):
            show_table(table)
    conclude(report)
