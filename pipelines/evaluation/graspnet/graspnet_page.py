"""`report.html` of a dump judged by GraspNet's protocol: tables, curves, what became of grasps."""

from collections.abc import Mapping, Sequence
from typing import Any

from pipelines.evaluation.graspnet.graspnet_figures import dump_tables, percent, scene_table
from pipelines.evaluation.pages.charts import Series, line_chart
from pipelines.evaluation.pages.report_page import (
    REASON_COLORS,
    html_table,
    note_list,
    page_sections,
    provenance_table,
    stacked_bars,
    tile_row,
    whole_page,
)
from pipelines.metrics.graspnet.graspnet_ap import RANKS
from pipelines.metrics.graspnet.graspnet_frames import REASONS

ALL = "all"
CHART_SPLITS = {"seen": "#1668b8", "similar": "#e08a00", "novel": "#2a9d58", "train": "#8e5bb5"}
FRICTION_COLORS = ("#0b3c6f", "#1668b8", "#5a9bd8", "#e6a817", "#e08a00", "#d0492f")
REACHABLE = "if all its grasps held"
COLORS = {reason: REASON_COLORS.get(reason, REASON_COLORS["no grasp"]) for reason in REASONS}
WORDS = {
    "collision": "the open gripper touches an object or the table",
    "empty": "hardly anything of the object is between its fingers",
    "no contact": "the closing fingers do not both touch it",
    "friction": "it would need friction above 1.2",
    "held": "held at a friction of 1.2 or less",
}
CURVE_NOTE = (
    "Share of a frame's k most confident grasps that hold, mean over frames; AP is its mean over "
    "k = 1 to 50. Grasps that a frame does not have count as failed, so no curve rises above the "
    "grey one."
)


def dump_page(report: Mapping[str, Any], name: str, faults: Mapping[str, str]) -> str:
    """Return the page of a dump's `report.json`.

    Args:
        report: as `formats.reports` reads it.
        name: of the dump.
        faults: scene to sentence, of what is wrong with its files.
    """
    precision, fates = map(html_table, dump_tables(report["rows"]))
    sections = [
        ("Average precision", [precision]),
        ("Accuracy by rank", [_charts(report["accuracy"]), f'<p class="note">{CURVE_NOTE}</p>']),
        ("What became of the ranked grasps", [_bars(report["rows"]), fates]),
        ("Scene by scene", [html_table(scene_table(report["scenes"]))]),
        ("How this was made", [provenance_table(report)]),
    ]
    if faults:
        told = note_list(f"{scene}: {sentence}" for scene, sentence in faults.items())
        sections.insert(1, ("Files at fault", [told]))
    how = "exact contacts and collision" if report["exact"] else "as graspnetAPI computes it"
    title = f"{name}: GraspNet's AP, {how}"
    return whole_page(title, _tiles(report["rows"]) + page_sections(sections))


def _tiles(rows: Mapping[str, Mapping[str, Any]]) -> str:
    tiles = []
    for camera, splits in rows.items():
        found = splits[ALL]
        named = (("AP", "ap"), ("AP 0.8", "ap_0.8"), ("AP 0.4", "ap_0.4"))
        tiles += [(percent(found[key]), label, camera) for label, key in named]
        ranked = sum(found["reasons"].values())
        held = found["reasons"].get("held", 0)
        tiles += [
            (percent(held / ranked if ranked else None), "percent held", f"of {ranked:,} ranked"),
            (f"{found['frames']:,}", "frames", f"{found['frames_absent']:,} absent"),
        ]
    return tile_row(tiles)


def _bars(rows: Mapping[str, Mapping[str, Any]]) -> str:
    bars = [
        (f"{camera}, {split}", figures["reasons"])
        for camera, splits in rows.items()
        for split, figures in splits.items()
        if figures["reasons"]
    ]
    return stacked_bars(bars, COLORS, WORDS)


def _charts(accuracy: Mapping[str, Mapping[str, Any]]) -> str:
    """Return two charts a camera: all splits by friction, and the mean of frictions by split."""
    charts = []
    for camera, splits in accuracy.items():
        every = splits[ALL]
        reachable = _curve(REACHABLE, every["reachable"], "#b9bec6", "5 4")
        by_friction = [
            _curve(f"friction {mu}", values, color)
            for (mu, values), color in zip(every["held"].items(), FRICTION_COLORS, strict=True)
        ]
        by_split = [
            _curve(split, splits[split]["mean"], color)
            for split, color in CHART_SPLITS.items()
            if split in splits
        ]
        words = ("k, most confident first", "share that hold")
        for title, lines in (
            ("all splits", [reachable, *by_friction]),
            ("mean over frictions", by_split),
        ):
            charts.append(line_chart(f"{camera}, {title}", *words, lines, x_end=RANKS))
    return f'<div class="charts">{"".join(charts)}</div>'


def _curve(name: str, values: Sequence[float], color: str, dashes: str = "") -> Series:
    return Series(name, range(1, len(values) + 1), values, color, dashes)
