"""`report.html` of a dump scored by GraspNet's protocol: tables, curves, outcomes of the grasps."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pipelines.evaluation.graspnet.graspnet_figures import dump_tables, percent, scene_table
from pipelines.evaluation.pages.charts import LineChart, Series
from pipelines.evaluation.pages.report_page import (
    REASON_COLORS,
    TEMPLATES,
    listed_notes,
    provenance_table,
)
from pipelines.evaluation.runs.tallies import ALL
from pipelines.metrics.graspnet.graspnet_ap import RANKS
from pipelines.metrics.graspnet.graspnet_frames import DUMP_REASONS
from pipelines.pictures.pages import rendered

CHART_SPLITS = {"seen": "#1668b8", "similar": "#e08a00", "novel": "#2a9d58", "train": "#8e5bb5"}
FRICTION_COLORS = ("#0b3c6f", "#1668b8", "#5a9bd8", "#e6a817", "#e08a00", "#d0492f")
REACHABLE = "if all grasps held"
COLORS = {reason: REASON_COLORS.get(reason, REASON_COLORS["no grasp"]) for reason in DUMP_REASONS}
WORDS = {
    "collision": "the open gripper touches an object or the table",
    "empty": "hardly any of the object is between the fingers",
    "no contact": "the closing fingers do not both touch the object",
    "friction": "the grasp would need friction above 1.2",
    "held": "held at a friction of 1.2 or less",
}


def dump_page(report: Mapping[str, Any], name: str, faults: Mapping[str, str]) -> str:
    """Return the page of the `report.json` of the dump `name`.

    `faults`: scene to a sentence on the fault of its files.
    """
    precision, outcomes = dump_tables(report["rows"])
    how = "exact contacts and collision" if report["exact"] else "as graspnetAPI computes it"
    return rendered(
        TEMPLATES / "dump.html",
        title=f"{name}: GraspNet's AP, {how}",
        tiles=_tiles(report["rows"]),
        notes=listed_notes(report),
        precision=precision,
        faults=[f"{scene}: {sentence}" for scene, sentence in faults.items()],
        charts=list(_charts(report["accuracy"])),
        bars=[
            (f"{camera}, {split}", figures["reasons"])
            for camera, splits in report["rows"].items()
            for split, figures in splits.items()
            if figures["reasons"]
        ],
        outcomes=outcomes,
        colors=COLORS,
        words=WORDS,
        scenes=scene_table(report["scenes"]),
        provenance=provenance_table(report),
    )


def _tiles(rows: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    tiles: list[tuple[str, str, str]] = []
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
    return tiles


def _charts(accuracy: Mapping[str, Mapping[str, Any]]) -> Iterator[LineChart]:
    """Yield two charts per camera: all splits by friction, and the mean of frictions by split."""
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
        words = ("k, most confident first", "share that holds")
        for title, lines in (
            ("all splits", [reachable, *by_friction]),
            ("mean over frictions", by_split),
        ):
            yield LineChart(f"{camera}, {title}", *words, lines, x_end=RANKS)


def _curve(name: str, values: Sequence[float], color: str, dashes: str = "") -> Series:
    return Series(name, range(1, len(values) + 1), values, color, dashes)
