"""Final report of a command, and its exit code."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.table import Table as Drawn

    from pipelines.evaluation.tables import Table
    from pipelines.runtime.batch import StageReport

UNBOUND = 10_000  # characters: a table as wide as it would like to be


def conclude(report: StageReport) -> None:
    """Print what was done, skipped and failed on stderr; exit 1 if anything failed."""
    if os.environ.get("TORCHELASTIC_RUN_ID") and os.environ.get("RANK", "0") != "0":
        raise typer.Exit(report.exit_code)  # of the processes of torchrun the first one speaks
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


def show_table(table: Table) -> None:
    """Print a table on stdout, names on the left, numbers on the right, what is meant below.

    Columns stand closer where the terminal is narrow. Files and pipes are as wide as the table,
    unless the variable COLUMNS says how wide.
    """
    from rich.console import Console
    from rich.measure import Measurement

    console = Console()
    drawn = _drawn(table, gap=1)
    unbound = console.options.update(width=UNBOUND)
    width = Measurement.get(console, unbound, drawn).maximum
    if width > console.width and (console.is_terminal or "COLUMNS" in os.environ):
        drawn = _drawn(table, gap=0)
    elif width > console.width:
        console = Console(width=width)
    console.print(drawn)
    if table.note:
        console.print(f"  {table.note}\n", style="dim", markup=False, highlight=False)


def _drawn(table: Table, gap: int) -> Drawn:
    from rich import box
    from rich.table import Table as Drawn

    drawn = Drawn(
        title=table.title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, gap, 0, 0),
    )
    for index, head in enumerate(table.header):
        is_name = index < table.names
        drawn.add_column(head, justify="left" if is_name else "right", no_wrap=is_name)
    for number, row in enumerate(table.rows, 1):
        drawn.add_row(*row, end_section=number == table.published)
    return drawn
