"""`report.html`: a report as one page, without other files and without a network."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipelines.errors import counted
from pipelines.evaluation.pages.charts import LineChart, Series
from pipelines.evaluation.pages.gallery import Gallery
from pipelines.evaluation.reports import published
from pipelines.evaluation.reports.published import Published
from pipelines.evaluation.reports.tables import Table, report_sections
from pipelines.evaluation.rows import OURS, PAPER_METHOD, report_row
from pipelines.evaluation.runs.tallies import ALL
from pipelines.geometry.symmetry import SYMMETRY_KINDS
from pipelines.metrics.grasp_verdicts import REASONS
from pipelines.pictures.pages import rendered

TEMPLATES = Path(__file__).parents[1] / "templates"

THRESHOLD_DASHES = ("", "7 4", "2 3")  # of the first thresholds, solid first
REASON_COLORS = dict(
    zip(REASONS, ("#b9bec6", "#8d939d", "#8e5bb5", "#d0492f", "#e6a817", "#f0d264", "#2f9e5b"),
        strict=True)
)  # fmt: skip
REASON_WORDS = {
    "no region": "no detected region is on the object",
    "no grasp": "the object's regions gave no grasp",
    "too wide": "the grasp is wider than the gripper opens",
    "collision": "the open gripper touches an object or the table",
    "no contact": "the closing fingers do not both touch the object",
    "friction": "the grasp would need friction above 1",
    "held": "held",
}


def report_page(report: Mapping[str, Any], gallery: Gallery) -> str:
    """Return the page of a `report.json` and its `gallery`."""
    sizes = _ours(report)
    frames = counted(sizes.get("frames", 0), "frame")
    objects = counted(sizes.get("objects", 0), "object")
    return rendered(
        TEMPLATES / "report.html",
        title=f"SymGrasp: {frames}, {objects}",
        tiles=_tiles(report),
        notes=listed_notes(report),
        sections=report_sections(report),
        charts={"Grasps": [*_held_charts(report)], "Symmetries": [*_symmetry_charts(report)]},
        bars=[
            (report_row(row).title, found[ALL]["reasons"]) for row, found in report["rows"].items()
        ],
        colors=REASON_COLORS,
        words=REASON_WORDS,
        gallery=gallery,
        provenance=provenance_table(report),
    )


def listed_notes(report: Mapping[str, Any]) -> list[str]:
    """Return the notes of a report as a list; earlier reports have none."""
    return [f"{subject}: {note}" for subject, note in report.get("notes", {}).items()]


def provenance_table(report: Mapping[str, Any]) -> Table:
    """Return the settings and inputs of a report as a table."""
    stamp = report.get("provenance", {})
    facts = [("symgrasp", stamp.get("version")), ("seed", stamp.get("seed"))]
    facts += [*stamp.get("inputs", {}).items(), *stamp.get("config", {}).items()]
    rows = tuple((str(name), str(value)) for name, value in facts)
    return Table("Settings and inputs", ("name", "value"), rows, names=2)


def _tiles(report: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return the headline figures, each with its name and the paper's figure."""
    figures = _ours(report)
    precision = figures.get("symmetry_ap", {})
    seconds = report.get("seconds_per_frame")
    kinds = zip(SYMMETRY_KINDS, published.SYMMETRY_AP[PAPER_METHOD], strict=True)
    tiles = [
        ("grasp quality", figures.get("grasp_quality"), _by_split(published.GRASP_QUALITY)),
        ("antipodal score", figures.get("antipodal_score"), _by_split(published.ANTIPODAL_SCORE)),
        *((f"AP {kind}", precision.get(kind), f"{paper:g}") for kind, paper in kinds),
        ("mask AP50", figures.get("mask_ap50"), _by_split(published.MASK_AP50)),
        ("seconds a frame", seconds, f"{published.SECONDS_PER_FRAME:g}"),
    ]
    success = figures.get("success", {}).get(ALL, {})
    if success:
        rates = published.SUCCESS_RATE[PAPER_METHOD]
        paper = f"{min(rates):g} to {max(rates):g}, real"
        tiles.insert(2, ("success in simulation", success["rate"], paper))
    return [
        ("-" if value is None else f"{value:.3f}", name, f"paper: {paper}")
        for name, value, paper in tiles
    ]


def _by_split(figures: Published) -> str:
    """Return the paper's own figures of a table in words."""
    seen, unseen = figures[PAPER_METHOD]
    return f"{seen:g} seen, {unseen:g} unseen"


def _ours(report: Mapping[str, Any]) -> Mapping[str, Any]:
    figures: Mapping[str, Any] = report["rows"].get(OURS, {}).get(ALL, {})
    return figures


def _held_charts(report: Mapping[str, Any]) -> Iterator[LineChart]:
    """Yield the chart of the share of objects held by friction, if evaluated."""
    curves = report.get("curves", {})
    lines = [
        Series(report_row(row).title, curves["friction"], share, report_row(row).color)
        for row, share in curves.get("held", {}).items()
    ]
    title = "Share of objects held at a friction, all splits"
    if lines:
        yield LineChart(title, "friction", "share of visible objects", lines)


def _symmetry_charts(report: Mapping[str, Any]) -> Iterator[LineChart]:
    """Yield our precision-recall curves: a chart per kind, with a line per threshold."""
    curves = report.get("curves", {})
    found = curves.get("symmetry", {}).get(OURS, {})
    blue = report_row(OURS).color
    for kind in SYMMETRY_KINDS:
        measure = "centre within {} m" if kind == "sphere" else "error below {}"
        lines = [
            Series(
                measure.format(key), *_reached(curves["recall"], precision), blue, _dashes(place)
            )
            for place, (key, precision) in enumerate(found.get(kind, {}).items())
        ]
        if lines:
            yield LineChart(f"{kind}, all splits", "recall", "precision", lines)


def _dashes(place: int) -> str:
    """Return the dashes of the line of the threshold at `place`, different for each."""
    few = place < len(THRESHOLD_DASHES)
    return THRESHOLD_DASHES[place] if few else f"{4 * place} 3 2 3"


def _reached(
    recall: Sequence[float], precision: Sequence[float]
) -> tuple[Sequence[float], Sequence[float]]:
    """Return a curve up to the first recall that no prediction reaches."""
    end = next((place + 1 for place, value in enumerate(precision) if not value), len(precision))
    return recall[:end], precision[:end]
