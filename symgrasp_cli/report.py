"""What a command says when it ends, and its exit code."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from pipelines.batch import StageReport


def conclude(report: StageReport) -> None:
    """Print what was done, skipped and failed on stderr; exit 1 if anything failed."""
    for name, note in report.notes.items():
        typer.echo(f"{name}: {note}", err=True)
    for name, sentence in report.failed.items():
        typer.echo(f"error: {name}: {sentence}", err=True)
    typer.echo(
        f"{report.stage}: {len(report.done)} done, {len(report.skipped)} skipped as finished, "
        f"{len(report.failed)} failed, {report.seconds:.1f} s",
        err=True,
    )
    if report.exit_code:
        raise typer.Exit(report.exit_code)


def show_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on stdout; the first two columns are names, the others numbers."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for index, head in enumerate(header):
        table.add_column(head, justify="left" if index < 2 else "right")
    for row in rows:
        table.add_row(*row)
    Console().print(table)
