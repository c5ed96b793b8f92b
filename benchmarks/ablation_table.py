"""The rows of Table IV, and the table made from the reports of several seeds.

Next to each of our figures is the paper's, measured on GraspNet-1Billion.
"""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipelines.errors import UnknownNameError

COLUMNS = ("seen", "similar", "novel", "all")
QUALITY = "grasp_quality"
METRICS = {
    QUALITY: "grasp quality",
    "antipodal_score": "antipodal score",
    "symmetry_ap reflection": "AP reflection",
    "symmetry_ap rotation": "AP rotation",
    "symmetry_ap sphere": "AP sphere",
    "mask_ap50": "mask AP50",
}
FULL, PLAIN, IN_CAMERA = "full", "plain", "predicted-in-camera"
NEITHER = "no-pift-no-siamese"
UNFITTED = ("--no-grounding", "--rank-by", "eq8")  # the paper's use of a network's output
NOTE = """\
Paper: GraspNet-1Billion, seen and unseen. Ours: the benchmark of `make eval`; an object without a
grasp counts as quality 0. All rows have the same training scenes, objects, steps and seeds, and
the same detector; the row without segmentation has its own, trained in the same way.
"""


@dataclass(frozen=True)
class Row:
    """One row of the table, with the part that it leaves out.

    Attributes:
        key: key in the names of files.
        name: name in the table.
        published: the paper's grasp quality, seen and unseen.
        base: key of the earlier row of the comparison; None for the first row.
        labels: folder of the labels that detector and network are trained on.
        train: options of `train`.
        infer: options of `infer`.
        network: key of the row with the network; None for a network of this row.
    """

    key: str
    name: str
    published: tuple[float, float] | None = None
    base: str | None = FULL
    labels: str = "refined"
    train: tuple[str, ...] = ()
    infer: tuple[str, ...] = ()
    network: str | None = None


NO_PIFT, NO_SIAMESE = (0.337, 0.092), (0.364, 0.148)
ABLATIONS = (  # the paper's claims first: the table grows in this order
    Row(FULL, "full method", (0.382, 0.297), None),
    Row(PLAIN, "as the paper decodes and ranks", (0.382, 0.297), infer=UNFITTED, network=FULL),
    Row("no-pift", "no PIFT", NO_PIFT, train=("--no-pift",)),
    Row(
        "plain-no-pift", "as the paper, no PIFT", NO_PIFT, PLAIN, infer=UNFITTED, network="no-pift"
    ),
    Row("no-siamese", "no Siamese training", NO_SIAMESE, train=("--no-siamese",)),
    Row(
        "plain-no-siamese",
        "as the paper, no Siamese training",
        NO_SIAMESE,
        PLAIN,
        infer=UNFITTED,
        network="no-siamese",
    ),
    Row(IN_CAMERA, "PIFT, input and output in the camera frame", train=("--no-canonical-frame",)),
    Row(
        f"plain-{IN_CAMERA}",
        "as the paper, input and output in the camera frame",
        None,
        PLAIN,
        infer=UNFITTED,
        network=IN_CAMERA,
    ),
    Row("no-regions", "no symmetric region segmentation", (0.350, 0.257), labels="uncut"),
    Row("no-refinement", "no dataset enhancement", (0.355, 0.240), labels="unrefined"),
    Row("mirrored", "mirror images too", infer=("--mirrored",), network=FULL),
    Row(
        "plain-mirrored",
        "as the paper, mirror images too",
        base=PLAIN,
        infer=(*UNFITTED, "--mirrored"),
        network=FULL,
    ),
    Row("no-grounding", "no fit to the seen surface", infer=UNFITTED[:1], network=FULL),
    Row("eq8", "ranked by Eq. 8", infer=UNFITTED[1:], network=FULL),
    Row("no-depth-regions", "no regions from depth", infer=("--regions", "detector"), network=FULL),
    Row(  # does Siamese training gain more if PIFT does not undo scalings already (D. 100)?
        NEITHER,
        "no PIFT, no Siamese training",
        base="no-pift",
        train=("--no-pift", "--no-siamese"),
    ),
    Row(
        f"plain-{NEITHER}",
        "as the paper, no PIFT, no Siamese training",
        base="plain-no-pift",
        infer=UNFITTED,
        network=NEITHER,
    ),
)


def rows_named(keys: Sequence[str]) -> tuple[Row, ...]:
    """Return the rows of `keys`, with the rows of their comparisons and networks.

    Raises:
        UnknownNameError: no row has this key.
    """
    known = {row.key: row for row in ABLATIONS}
    wanted, open_keys = {FULL}, list(keys)
    while open_keys:
        key = open_keys.pop()
        if key not in known:
            raise UnknownNameError("row", key, tuple(known))
        if key not in wanted:
            wanted.add(key)
            open_keys += {known[key].base, known[key].network} - {None}
    return tuple(row for row in ABLATIONS if row.key in wanted)


def summary(
    reports: Mapping[str, Sequence[Any]],
    compared: Mapping[str, Sequence[Any]],
    seeds: Sequence[int],
) -> dict[str, Any]:
    """Return the table of the rows that have reports, as a JSON object.

    Args:
        reports: key of a row -> the `report.json` of each seed.
        compared: key of a row with a base -> the `compare.json` of each seed, base first.
        seeds: seeds of the trainings.
    """
    rows = {}
    for row in (row for row in ABLATIONS if row.key in reports):
        figures = [report["rows"]["ours"] for report in reports[row.key]]
        found: dict[str, Any] = {"name": row.name, "published": row.published, "base": row.base}
        for split in COLUMNS:
            found[split] = {
                metric: _over_seeds([_value(each.get(split), metric) for each in figures])
                for metric in METRICS
            }
            if row.base is not None:
                found[split]["difference"] = _difference(compared[row.key], split)
        rows[row.key] = found
    return {"seeds": list(seeds), "rows": rows, "format_version": 2}


def _value(figures: Mapping[str, Any] | None, metric: str) -> float | None:
    """Return a metric of a report; None if the report lacks it."""
    value: Any = figures
    for name in metric.split():
        value = value.get(name) if isinstance(value, Mapping) else None
    return None if value is None else float(value)


def _difference(compared: Sequence[Any], split: str) -> dict[str, Any]:
    """Return the difference of a row's quality to its base's for each seed.

    A split that the benchmark lacks has no differences.
    """
    known = [one["figures"][split] for one in compared if split in one["figures"]]
    each = [figures[QUALITY]["differences"][0] for figures in known]
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


def ablation_page(found: Mapping[str, Any]) -> str:
    """Return the result of `summary` as a page: qualities, differences, other metrics."""
    rows = found["rows"]
    heads, qualities = _qualities(rows)
    differences = [
        (
            _against(row, rows),
            *_published(row, rows),
            *(_above(row[split]) for split in COLUMNS),
        )
        for row in rows.values()
        if row["base"] is not None
    ]
    others = [metric for metric in METRICS if metric != QUALITY]
    rest = [(row["name"], *(_text(row["all"][each]) for each in others)) for row in rows.values()]
    parts = (
        "# Table IV: one part left out at a time\n",
        f"{NOTE}{_spread_note(len(found['seeds']))}\n",
        "## Grasp quality\n",
        _table(heads, qualities),
        "## Grasp quality, difference to another row\n",
        _table(heads, differences),
        "## Other metrics, all splits\n",
        _table(("", *(METRICS[each] for each in others)), rest),
    )
    return "\n".join(parts)


def report_table(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the qualities in the result of `summary` as a table of `symgrasp evaluate --table`."""
    heads, qualities = _qualities(found["rows"])
    note = f"{NOTE}{_spread_note(len(found['seeds']))}".replace("\n", " ")
    title = "Table IV. Grasp quality with one part left out at a time"
    return {"title": title, "header": ["row", *heads[1:]], "rows": qualities, "note": note}


def _qualities(rows: Mapping[str, Any]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    heads = ("", "paper seen", "paper unseen", *COLUMNS)
    return heads, [
        (row["name"], *_published(row), *(_text(row[split][QUALITY]) for split in COLUMNS))
        for row in rows.values()
    ]


def _against(row: Mapping[str, Any], rows: Mapping[str, Any]) -> str:
    base = "" if row["base"] == FULL else f" (to: {rows[row['base']]['name']})"
    return f"{row['name']}{base}"


def _spread_note(count: int) -> str:
    if count > 1:
        return f"Means of {count} seeds, ± their standard deviation."
    return (
        "One seed; intervals: 95 %, paired bootstrap over scenes, without the spread between\n"
        "trainings, which needs more seeds."
    )


def _published(row: Mapping[str, Any], rows: Mapping[str, Any] | None = None) -> tuple[str, str]:
    """Return the paper's seen and unseen quality, or differences to the base if `rows` is given."""
    base = (0.0, 0.0) if rows is None else rows[row["base"]]["published"]
    if row["published"] is None or (rows is not None and row["published"] == base):
        return "-", "-"
    form = ".3f" if rows is None else "+.3f"
    seen, unseen = (f"{v - b:{form}}" for v, b in zip(row["published"], base, strict=True))
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
    if low is None or high is None:  # intervals of one scene
        return f"{figure['mean']:+.3f}"
    return f"{figure['mean']:+.3f} ({low:+.3f} to {high:+.3f})"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
