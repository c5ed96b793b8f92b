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
            help="Two or more report.json of `evaluate`, or success.json of `simulate`; the others "
            "are compared with the first.",
        ),
    ],
    *,
    out: Annotated[
        Path | None, typer.Option(help="Comparison to write, .json or .html; none by default.")
    ] = None,
    row: Annotated[
        str,
        typer.Option(help="Row of the reports: ours, oracle, planar, random; of a dump a camera."),
    ] = CompareConfig.row,
    unit: Annotated[
        str,
        typer.Option(help="What the bootstrap draws: frame, or scene, whose views are alike."),
    ] = CompareConfig.unit,
    resamples: Annotated[
        int, typer.Option(min=1, help="Draws of the bootstrap.")
    ] = CompareConfig.resamples,
    seed: Seed = 0,
    overwrite: Overwrite = False,
) -> None:
    """Put several reports or simulations side by side, with intervals of their differences."""
    if len(reports) < 2:
        raise typer.BadParameter("one report has nothing to be compared with; give two or more")
    if out is not None and out.suffix not in {".json", ".html"}:
        raise typer.BadParameter(f"{out} is neither .json nor .html; name one of these")
    from pipelines import compare as stage

    config = CompareConfig(row=row, unit=unit, resamples=resamples)
    found = stage.run(reports, config, out, seed=seed, overwrite=overwrite)
    for table in stage.tables(found):
        show_table(table)
    for note in found.notes:
        typer.echo(note, err=True)
