"""`symgrasp compare`."""

from pathlib import Path
from typing import Annotated

import typer

from pipelines.configs import CompareConfig
from symgrasp_cli.options import Overwrite, Seed
from symgrasp_cli.report import conclude
from symgrasp_cli.settings import named_as, with_settings


@with_settings("compare", named_as("row", "unit", "resamples"))
def compare(
    config: CompareConfig,
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
    seed: Seed = 0,
    overwrite: Overwrite = False,
) -> None:
    """Put several reports or simulations side by side, with intervals of their differences."""
    if len(reports) < 2:
        raise typer.BadParameter("one report has nothing to be compared with; give two or more")
    if out is not None and out.suffix not in {".json", ".html"}:
        raise typer.BadParameter(f"{out} is neither .json nor .html; name one of these")
    from pipelines import compare as stage
    from pipelines.runtime.batch import StageReport

    found = stage.run(reports, config, out, seed=seed, overwrite=overwrite)
    report = StageReport("compare", done=[str(path) for path in reports])
    conclude(report, out, tables=stage.tables(found), lines=found.notes)
