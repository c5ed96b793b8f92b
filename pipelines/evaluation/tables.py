"""The report as tables of text, and as one self-contained HTML page."""

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from pipelines.evaluation.figures import Figures
from pipelines.metrics.grasp_verdicts import REASONS
from pipelines.metrics.symmetry_matching import KINDS

ReportRows = Mapping[str, Mapping[str, Figures]]

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 60rem; padding: 0 1rem }
table { border-collapse: collapse; margin: 0 0 2rem }
caption { text-align: left; font-weight: 600; padding: 0 0 .4rem }
th, td { padding: .25rem .8rem; border-bottom: 1px solid #ddd; text-align: right }
th:nth-child(-n+2), td:nth-child(-n+2) { text-align: left }
"""


@dataclass(frozen=True)
class Table:
    """A title, column heads, and rows of text."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def report_tables(rows: ReportRows) -> list[Table]:
    """Return the tables of a report, in the order in which they are read."""
    return [_grasp_table(rows), _symmetry_table(rows), _mask_table(rows), _reason_table(rows)]


def report_page(title: str, tables: Sequence[Table]) -> str:
    """Return an HTML page of `tables` that needs no other file and no network."""
    body = "\n".join(_html_table(table) for table in tables)
    head = f'<meta charset="utf-8"><title>{html.escape(title)}</title><style>{STYLE}</style>'
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}</head>\n'
        f"<body><h1>{html.escape(title)}</h1>\n{body}\n</body></html>\n"
    )


def _grasp_table(rows: ReportRows) -> Table:
    header = ("method", "split", "quality", "antipodal", "region", "grasped", "frames", "objects")
    return Table(
        "Grasp quality, antipodal score of contacts and of the closing region, quality if grasped",
        header,
        tuple(
            (
                row,
                split,
                _number(figures["grasp_quality"]),
                _number(figures["antipodal_score"]),
                _number(figures["antipodal_score_region"]),
                _number(figures["grasp_quality_predicted"]),
                str(figures["frames"]),
                str(figures["objects"]),
            )
            for row, split, figures in _cells(rows)
        ),
    )


def _symmetry_table(rows: ReportRows) -> Table:
    cells = [
        (row, split, figures["symmetry_ap"])
        for row, split, figures in _cells(rows)
        if any(value is not None for value in figures["symmetry_ap"].values())
    ]
    body = tuple((row, split, *(_number(ap[kind]) for kind in KINDS)) for row, split, ap in cells)
    return Table("Symmetry, average precision", ("method", "split", *KINDS), body)


def _mask_table(rows: ReportRows) -> Table:
    splits = rows.get("ours", {})
    body = tuple(("ours", split, _number(found["mask_ap50"])) for split, found in splits.items())
    return Table("Region masks", ("method", "split", "AP50"), body)


def _reason_table(rows: ReportRows) -> Table:
    cells = [cell for cell in _cells(rows) if cell[2]["objects"]]
    reasons = [r for r in REASONS if any(figures["reasons"].get(r) for _, _, figures in cells)]
    body = tuple(
        (row, split, *(_percent(figures, reason) for reason in reasons))
        for row, split, figures in cells
    )
    return Table("What became of the objects, percent", ("method", "split", *reasons), body)


def _cells(rows: ReportRows) -> Iterable[tuple[str, str, Figures]]:
    for row, splits in rows.items():
        for split, figures in splits.items():
            if figures["frames"]:
                yield row, split, figures


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _percent(figures: Figures, reason: str) -> str:
    return f"{100.0 * figures['reasons'].get(reason, 0) / figures['objects']:.0f}"


def _html_table(table: Table) -> str:
    head = _html_row("th", table.header)
    body = "\n".join(_html_row("td", row) for row in table.rows)
    return f"<table><caption>{html.escape(table.title)}</caption>\n{head}\n{body}\n</table>"


def _html_row(tag: str, cells: Iterable[str]) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"
