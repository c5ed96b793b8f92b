"""The rows of Table IV, and how the reports of several seeds become one table.

Beside each of ours stands the paper's, measured on GraspNet-1Billion.
"""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

SPLITS = ("seen", "similar", "novel", "all")
QUALITY = "grasp_quality"
METRICS = {
    QUALITY: "grasp quality",
    "antipodal_score": "antipodal score",
    "symmetry_ap reflection": "AP reflection",
    "symmetry_ap rotation": "AP rotation",
    "symmetry_ap sphere": "AP sphere",
    "mask_ap50": "mask AP50",
}
FULL = "full"
NOTE = """\
Paper: GraspNet-1Billion, seen and unseen. Ours: the benchmark of `make eval`; an object without a
grasp counts as quality 0. All rows have the same training scenes, objects, steps and seeds, and a
detector of the same steps.
"""


@dataclass(frozen=True)
class Row:
    """One row: what it leaves out.

    Attributes:
        key: of its files.
        name: of the table.
        published: the paper's grasp quality, seen and unseen.
        labels: folder of the labels that detector and network are trained on.
        train: options of `train`.
        infer: options of `infer`.
        network: key of the row whose network it takes; None for one of its own.
    """

    key: str
    name: str
    published: tuple[float, float] | None
    labels: str = "refined"
    train: tuple[str, ...] = ()
    infer: tuple[str, ...] = ()
    network: str | None = None


ROWS = (  # the first is what the others are compared with
    Row(FULL, "full method", (0.382, 0.297)),
    Row("no-pift", "no PIFT", (0.337, 0.092), train=("--no-pift",)),
    Row("no-siamese", "no Siamese training", (0.364, 0.148), train=("--no-siamese",)),
    Row("no-regions", "no symmetric region segmentation", (0.350, 0.257), labels="uncut"),
    Row("no-refinement", "no dataset enhancement", (0.355, 0.240), labels="unrefined"),
    Row(
        "no-grounding",
        "no fit to the seen surface",
        None,
        infer=("--no-grounding",),
        network=FULL,
    ),
    Row("eq8", "ranked by Eq. 8", None, infer=("--rank-by", "eq8"), network=FULL),
    Row(
        "no-depth-regions",
        "no regions from depth alone",
        None,
        infer=("--regions", "detector"),
        network=FULL,
    ),
)


def summary(
    reports: Mapping[str, Sequence[Any]], compared: Sequence[Any], seeds: Sequence[int]
) -> dict[str, Any]:
    """Return the table as a JSON object.

    Args:
        reports: of each row's key, the `report.json` of each seed.
        compared: the `compare.json` of each seed, its runs in the order of ROWS.
        seeds: of the trainings.
    """
    rows = {}
    for place, row in enumerate(ROWS):
        figures = [report["rows"]["ours"] for report in reports[row.key]]
        found: dict[str, Any] = {"name": row.name, "published": row.published}
        for split in SPLITS:
            found[split] = {
                metric: _over_seeds([_value(each.get(split), metric) for each in figures])
                for metric in METRICS
            }
            if place:
                found[split]["difference"] = _difference(compared, split, place - 1)
        rows[row.key] = found
    return {"seeds": list(seeds), "rows": rows, "format_version": 1}


def _value(figures: Mapping[str, Any] | None, metric: str) -> float | None:
    """Return a metric of a report, None where there is none."""
    value: Any = figures
    for name in metric.split():
        value = value.get(name) if isinstance(value, Mapping) else None
    return None if value is None else float(value)


def _difference(compared: Sequence[Any], split: str, place: int) -> dict[str, Any]:
    """Return by how much the quality of row `place` is above the full method's, of each seed."""
    each = [one["figures"][split][QUALITY]["differences"][place] for one in compared]
    intervals = [[difference["low"], difference["high"]] for difference in each]
    return {**_over_seeds([difference["value"] for difference in each]), "intervals": intervals}


def _over_seeds(values: Sequence[float | None]) -> dict[str, Any]:
    """Return the values, their mean, and their standard deviation if there are two or more."""
    known = [value for value in values if value is not None]
    return {
        "values": list(values),
        "mean": statistics.fmean(known) if known else None,
        "spread": statistics.stdev(known) if len(known) > 1 else None,
    }


def markdown(found: Mapping[str, Any]) -> str:
    """Return the object of `summary` as a page: qualities, differences, the other metrics."""
    rows = found["rows"]
    heads = ("", "paper seen", "paper unseen", *SPLITS)
    base = rows[FULL]["published"]
    qualities = [
        (row["name"], *_published(row), *(_text(row[split][QUALITY]) for split in SPLITS))
        for row in rows.values()
    ]
    differences = [
        (row["name"], *_published(row, base), *(_above(row[split]) for split in SPLITS))
        for key, row in rows.items()
        if key != FULL
    ]
    others = [metric for metric in METRICS if metric != QUALITY]
    rest = [(row["name"], *(_text(row["all"][each]) for each in others)) for row in rows.values()]
    parts = (
        "# Table IV: one part left out at a time\n",
        f"{NOTE}{_spread_note(len(found['seeds']))}\n",
        "## Grasp quality\n",
        _table(heads, qualities),
        "## Grasp quality above the full method's\n",
        _table(heads, differences),
        "## Other metrics, all splits\n",
        _table(("", *(METRICS[each] for each in others)), rest),
    )
    return "\n".join(parts)


def _spread_note(count: int) -> str:
    if count > 1:
        return f"Means of {count} seeds, ± their standard deviation."
    return (
        "One seed; intervals: 95 %, paired bootstrap over frames, so without the spread between\n"
        "trainings, which more seeds would show."
    )


def _published(row: Mapping[str, Any], base: Sequence[float] | None = None) -> tuple[str, str]:
    """Return the paper's seen and unseen, as differences to `base` if given."""
    if row["published"] is None:
        return "-", "-"
    if base is None:
        seen, unseen = (f"{value:.3f}" for value in row["published"])
    else:
        pairs = zip(row["published"], base, strict=True)
        seen, unseen = (f"{value - full:+.3f}" for value, full in pairs)
    return seen, unseen


def _text(figure: Mapping[str, Any]) -> str:
    if figure["mean"] is None:
        return "-"
    spread = "" if figure["spread"] is None else f" ± {figure['spread']:.3f}"
    return f"{figure['mean']:.3f}{spread}"


def _above(figures: Mapping[str, Any]) -> str:
    figure = figures["difference"]
    if figure["mean"] is None:
        return "-"
    if figure["spread"] is not None:
        return f"{figure['mean']:+.3f} ± {figure['spread']:.3f}"
    low, high = figure["intervals"][0]
    return f"{figure['mean']:+.3f} ({low:+.3f} to {high:+.3f})"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
