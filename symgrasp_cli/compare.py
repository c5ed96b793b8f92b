"""`symgrasp compare`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import CompareConfig
from symgrasp_cli.options import Overwrite, Seed
from symgrasp_cli.report import show_table


def compare(
    reports: Annotated[
        list[Path],
        typer.Argument(
            exists=True,
            dir_okay=False,
            help="Two or more report.json of `evaluate`; the others are compared with the first.",
        ),
    ],
    *,
    out: Annotated[
        Path | None, typer.Option(help="Comparison to write, .json or .html; none by default.")
    ] = None,
    row: Annotated[
        str, typer.Option(help="Row of the reports: ours, oracle, planar or random.")
    ] = CompareConfig.row,
    resamples: Annotated[
        int, typer.Option(min=1, help="Draws of the bootstrap.")
    ] = CompareConfig.resamples,
    seed: Seed = 0,
    overwrite: Overwrite = False,
) -> None:
    """Put several runs of `evaluate` side by side, with intervals of their differences."""
    from pipelines import compare as stage

    config = CompareConfig(row=row, resamples=resamples)
    found = stage.run(reports, config, out, seed=seed, overwrite=overwrite)
    for table in stage.tables(found):
        show_table(table)
    for note in found.notes:
        typer.echo(note, err=True)
