"""Final report of a command: sentences on stderr, JSON on stdout, and the exit code."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from pipelines.errors import SymgraspError, error_sentence, printable

if TYPE_CHECKING:
    from rich.table import Table as Drawn

    from pipelines.evaluation.reports.tables import Table
    from pipelines.runtime.batch import StageReport

UNBOUND = 10_000  # characters: the width of a table without a limit
FEW = 3  # failures of the same reason that are printed as a sentence each
USAGE_ERROR: Any = typer.BadParameter.__base__  # click's or typer's own


@dataclass(frozen=True)
class ReportStyle:
    """Form of a report: `as_json` on stdout, `quiet` for warnings and errors only on stderr."""

    as_json: bool = False
    quiet: bool = False


_report_style: ContextVar[ReportStyle | None] = ContextVar("report_style", default=None)


def report_style() -> ReportStyle:
    """Return the style of the running command's report."""
    return _report_style.get() or ReportStyle()


@contextmanager
def reporting_in(style: ReportStyle) -> Iterator[None]:
    """Report in `style` inside this context."""
    token = _report_style.set(style)
    try:
        yield
    finally:
        _report_style.reset(token)


@contextmanager
def failure_as_json(arguments: Sequence[str]) -> Iterator[None]:
    """Print an error that ends the command as JSON, if its `arguments` ask for JSON."""
    try:
        yield
    except (SymgraspError, OSError, USAGE_ERROR) as error:
        if "--json" in arguments:
            command = next((each for each in arguments if not each.startswith("-")), None)
            of_usage = getattr(error, "format_message", None)
            sentence = " ".join(of_usage().split()) if of_usage else error_sentence(error)
            typer.echo(json.dumps({"command": command, "ok": False, "error": sentence}))
        raise


def conclude(
    report: StageReport,
    *outputs: Path | None,
    then: Sequence[str | Path] = (),
    tables: Sequence[Table] = (),
    lines: Sequence[str] = (),
    facts: Mapping[str, object] | None = None,
) -> None:
    """Print the items done, skipped and failed, the outputs and the usual next command.

    Exits with 1 if anything failed. `outputs`: files and folders that were to be written; None is
    left out. `then`: words of the next `symgrasp` command; it is left out if nothing is
    finished, no output exists yet, or the report does not allow it. `tables`: printed on stdout,
    or part of the JSON object. `lines`: further sentences for people. `facts`: further entries of
    the JSON object.
    """
    if os.environ.get("TORCHELASTIC_RUN_ID") and os.environ.get("RANK", "0") != "0":
        raise typer.Exit(report.exit_code)  # only torchrun's first process reports
    written = [str(each) for each in outputs if each is not None and each.exists()]
    exists = bool(written) or not any(outputs)  # a training may stop before the first weights
    is_next = bool(then) and report.has_next and exists and bool(report.done or report.skipped)
    following = shlex.join(["symgrasp", *map(str, then)]) if is_next else None
    if report_style().as_json:
        found = {"tables": [asdict(table) for table in tables]} if tables else {}
        typer.echo(json.dumps(_as_json(report, written, following) | found | dict(facts or {})))
    else:
        for table in tables:
            show_table(table)
    _print_report(report, written, following, lines)
    if report.exit_code:
        raise typer.Exit(report.exit_code)


def _print_report(
    report: StageReport, written: Sequence[str], following: str | None, lines: Sequence[str]
) -> None:
    """Print the report for people; only the errors if the user wants quiet."""
    notes = [f"{name}: {note}" for name, note in report.notes.items()]
    errors = _error_lines(report.failed)
    counts = (
        f"{report.stage}: {len(report.done)} done, {len(report.skipped)} skipped as finished, "
        f"{len(report.failed)} failed, {report.seconds:.1f} s"
    )
    ends = [*lines, *(f"output: {path}" for path in written)]
    ends += [f"next: {following}"] if following else []
    for text in errors if report_style().quiet else [*notes, *errors, counts, *ends]:
        typer.echo(printable(text), err=True)


def _error_lines(failed: Mapping[str, str]) -> list[str]:
    """Return a line for each failure; many of the same reason share a sentence.

    The same reason: the sentences differ only in the last part of the item's name.
    """
    groups: dict[str, list[str]] = {}
    for name, sentence in failed.items():
        groups.setdefault(sentence.replace(name.rpartition("/")[2], "*"), []).append(name)
    lines = []
    for names in groups.values():
        shown = names if len(names) <= FEW else names[:1]
        lines += [f"error: {name}: {failed[name]}" for name in shown]
        if others := names[len(shown) :]:
            lines.append(f"error: {len(others)} more for the same reason: {', '.join(others)}")
    return lines


def _as_json(
    report: StageReport, written: Sequence[str], following: str | None
) -> dict[str, object]:
    return {
        "command": report.stage,
        "ok": not report.failed,
        "done": report.done,
        "skipped": report.skipped,
        "failed": report.failed,
        "notes": report.notes,
        "seconds": round(report.seconds, 3),
        "outputs": list(written),
        "next": following,
    }


def show_table(table: Table) -> None:
    """Print a table on stdout, names on the left, numbers on the right, notes below.

    Columns are closer on a narrow terminal. Output to files and pipes is as wide as the table,
    unless the environment variable COLUMNS sets the width.
    """
    from rich.console import Console
    from rich.measure import Measurement

    console = Console()
    drawn = _drawn(table, gap=1)
    width = Measurement.get(console, console.options.update(width=UNBOUND), drawn).maximum
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
        drawn.add_row(*map(printable, row), end_section=number == table.published)
    return drawn
