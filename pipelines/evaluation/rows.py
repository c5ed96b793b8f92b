"""The rows of reports: a registry of the compared methods, with titles and colours."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

OURS: Final = "ours"
PAPER_METHOD: Final = "SymmetryGrasp"  # in the paper's own tables


@dataclass(frozen=True)
class ReportRow:
    """One method of a report.

    Attributes:
        name: in `report.json`.
        title: in tables and charts.
        color: in charts, as a CSS colour.
        meaning: for the note below the tables; empty for none.
        published: the paper's name of the method, as in `published.py`; empty for none.
    """

    name: str
    title: str
    color: str
    meaning: str = ""
    published: str = ""


def _peer(name: str, color: str, published: str) -> ReportRow:
    """Return the row of a compared method, of `infer --method NAME`."""
    meaning = "the paper's compared method, trained by train-baseline"
    return ReportRow(name, f"{published}, trained here", color, meaning, published)


SELECTED: Final = "-selected"
AS_PRINTED: Final = "as-printed"
BY_FITTING: Final = "symmetry-icp"

# In the order of the tables.
KNOWN_ROWS = (
    ReportRow(OURS, "SymGrasp", "#1668b8", "ours, on the dataset evaluated here", PAPER_METHOD),
    ReportRow(
        AS_PRINTED, "SymmetryGrasp as printed", "#7b3fa0", "ours with --preset paper", PAPER_METHOD
    ),
    _peer("multi-grasp", "#6d4c41", "Multi-Grasp"),
    _peer("gg-cnn", "#00897b", "GG-CNN"),
    _peer("pointnetgpd", "#c0392b", "PointNetGPD"),
    _peer("graspnet", "#ad1457", "GraspNet"),
    ReportRow(
        "symmetrynet",
        "SymmetryNet, trained here",
        "#4527a0",
        "its symmetries, trained by train-baseline, then our selection",
        "SymmetryNet [32]",
    ),
    ReportRow(
        BY_FITTING,
        "symmetry by fitting",
        "#8d6e63",
        "symmetries fitted to the points alone, then our selection",
        "geometry [7]",
    ),
    ReportRow("true-regions", "on true regions", "#0277bd", "ours on the true symmetric regions"),
    ReportRow(
        "constant-affordance",
        "constant affordance",
        "#5c8fbf",
        "ours with the same affordance at all points",
    ),
    ReportRow("random-network", "random network", "#90a4ae", "ours with an untrained network"),
    ReportRow(
        "oracle", "oracle", "#2a9d58", "true symmetries and affordance through the same selection"
    ),
    ReportRow(
        "planar-critic",
        "planar + critic",
        "#b35c00",
        "from the outline of the region, ranked by the grasp critic",
    ),
    ReportRow("planar", "planar", "#e08a00", "from the outline of the region, ranked by Eq. 8"),
    ReportRow("random", "random", "#8a8f98", "random grasps that the gripper can do"),
)
BASELINE_ROWS = ("oracle", "planar-critic", "planar", "random")
OTHER_COLORS = ("#c2185b", "#00838f", "#5d4037", "#7cb342", "#303f9f", "#f06292")


def report_row(name: str) -> ReportRow:
    """Return the row called `name`; a row of `--with NAME.h5` has the name of its file.

    `METHOD-selected` is a compared method with our selection of its grasps.
    """
    known = {row.name: row for row in KNOWN_ROWS}
    if name in known:
        return known[name]
    method = known.get(name.removesuffix(SELECTED))
    if method is not None and name.endswith(SELECTED):
        title, meaning = f"{method.published} + our selection", "its grasps that are feasible"
        return ReportRow(name, title, method.color, meaning)
    color = OTHER_COLORS[sum(name.encode()) % len(OTHER_COLORS)]
    return ReportRow(name, name, color, f"grasps of {name}.h5")


def ordered_rows(names: Iterable[str]) -> list[str]:
    """Return row names in the order of the tables: ours, rows of files, then the baselines."""
    order = {row.name: place for place, row in enumerate(KNOWN_ROWS)}
    others = order["oracle"] - 0.5
    return sorted(names, key=lambda name: (order.get(name, others), name))


def rows_note(names: Iterable[str]) -> str:
    """Return one sentence on the meaning of the rows `names`."""
    rows = [report_row(name) for name in ordered_rows(names)]
    words = "; ".join(f"{row.title}: {row.meaning}" for row in rows if row.meaning)
    return f"{words}." if words else ""
