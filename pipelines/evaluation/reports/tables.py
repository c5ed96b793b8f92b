"""The tables of a report: the paper's I to III with our rows added, symmetries, masks, failures.

The paper has the splits seen and unseen; our reports have seen, similar and novel, where similar
and novel together are unseen.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pipelines.contents import mapping_in
from pipelines.errors import counted
from pipelines.evaluation.reports import published
from pipelines.evaluation.reports.figures import TEST_SPLITS, Figures
from pipelines.evaluation.reports.published import Published
from pipelines.evaluation.rows import OURS, report_row, rows_note
from pipelines.evaluation.runs.bootstrap_units import interval_note
from pipelines.evaluation.runs.tallies import ALL, WITHOUT_GRASP
from pipelines.geometry.symmetry import SYMMETRY_KINDS
from pipelines.metrics.grasp_verdicts import REASONS
from pipelines.metrics.graspnet.graspnet_ap import AP_FIGURES

ReportRows = Mapping[str, Mapping[str, Figures]]

UNSEEN = ("similar", "novel")
SUCCESS_KINDS = (*SYMMETRY_KINDS, "none", ALL)
TABLE_FRICTION = "0.5"  # of the simulated trials that are shown by split, and in FIGURES
NO_SUCCESS = (
    "SymGrasp was not simulated: `symgrasp simulate`, then `symgrasp evaluate --success "
    "success.json`"
)


@dataclass(frozen=True)
class Table:
    """A title, column heads, and rows of text; `note` is a line of explanation below."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    published: int = 0  # number of first rows that are from the paper
    names: int = 1  # number of first columns that are names, not numbers


def report_tables(report: Mapping[str, Any]) -> list[Table]:
    """Return the tables of a `report.json`, in the order of the page."""
    return [table for tables in report_sections(report).values() for table in tables]


def report_sections(report: Mapping[str, Any]) -> dict[str, list[Table]]:
    """Return the tables of a `report.json` by heading."""
    rows: ReportRows = report["rows"]
    title = "Table I. Grasp quality, 1 - mu"
    quality = split_table(report, "grasp_quality", published.GRASP_QUALITY, title)
    quality = replace(quality, note=f"{quality.note} {rows_note(rows)}{_left_out(report)}")
    title = "Table I by a sweep of mu in steps of 0.1"
    swept = split_table(report, "grasp_quality_swept", published.GRASP_QUALITY, title)
    title = "Table II. Antipodal score of the contact pair"
    pair = split_table(report, "antipodal_score", published.ANTIPODAL_SCORE, title)
    title = "Antipodal score of the closing region (S4G's)"
    region = split_table(report, "antipodal_score_region", {}, title)
    sections: dict[str, list[Table | None]] = {
        "Grasps": [quality, swept, pair, region, graspnet_table(report)],
        "Success": [success_table(report), trial_table(report)],
        "Symmetries": [symmetry_table(report)],
        "Region masks": [mask_table(rows)],
        "Outcomes of the objects": [reason_table(rows)],
        "Further tables": [given_table(each) for each in report.get("tables", [])],
    }
    return {
        heading: [table for table in tables if table is not None]
        for heading, tables in sections.items()
    }


def given_table(content: Mapping[str, Any]) -> Table:
    """Return a table that was given by `evaluate --table`."""
    rows = tuple(tuple(cells) for cells in content["rows"])
    return Table(content["title"], tuple(content["header"]), rows, content.get("note", ""))


def _left_out(report: Mapping[str, Any]) -> str:
    failed = report.get("failed") or {}
    if not failed:
        return ""
    scene, why = next(iter(failed.items()))
    scenes = counted(len(failed), "scene")
    return f" Left out: {scenes} that could not be evaluated, for example {scene}: {why}."


def split_table(report: Mapping[str, Any], figure: str, paper: Published, title: str) -> Table:
    """Return a mean over objects by method and split, the paper's rows first."""
    rows: ReportRows = report["rows"]
    is_trained_on = any(figures.get("train", {}).get("frames") for figures in rows.values())
    splits = ["seen", "unseen", *UNSEEN, *(["train"] if is_trained_on else []), ALL]
    blank = ("",) * (len(splits) - 2)
    body = [(method, *map(_number, found), *blank) for method, found in paper.items()]
    for row, figures in rows.items():
        found = [_number(_mean(figures, figure, s)) for s in splits]
        found[-1] += _between(figures[ALL], figure)
        body.append((report_row(row).title, *found))
        if any(_mean(figures, f"{figure}_predicted", s) is not None for s in splits):
            found = [_number(_mean(figures, f"{figure}_predicted", s)) for s in splits]
            body.append((f"{report_row(row).title}, if grasped", *found))
    source = f"First rows: {published.SOURCE}. " if paper else ""
    note = (
        f"{source}An object without a grasp counts 0; the rows `if grasped` leave it out, as the "
        f"paper does; unseen is similar and novel together. {interval_note(report)}"
    )
    return Table(title, ("method", *splits), tuple(body), note, len(paper))


def success_table(report: Mapping[str, Any]) -> Table:
    """Return the success rates by symmetry: the paper's on a robot, ours in simulation."""
    body = [
        (method, "", "", *(f"{100 * rate:.0f}" for rate in rates), "")
        for method, rates in published.SUCCESS_RATE.items()
    ]
    for row, by_split in _simulated(report, "success").items():
        by_kind = by_split.get(ALL, {})
        frictions = sorted({key for found in by_kind.values() for key in found}, key=float)
        for split, key in [
            *((ALL, key) for key in frictions),
            *((split, TABLE_FRICTION) for split in TEST_SPLITS if split in by_split),
        ]:
            rates = (_rate(by_split[split].get(kind, {}).get(key)) for kind in SUCCESS_KINDS)
            body.append((report_row(row).title, key, split, *rates))
    ours = report.get("success_by_friction", {}).get(ALL, {})
    note = f"First rows: {published.SOURCE_ROBOT}. {_success_note(ours)}."
    title = "Table III. Success rate by symmetry of the grasped region, percent"
    header = ("method", "mu", "split", *SUCCESS_KINDS)
    return Table(title, header, tuple(body), note, len(published.SUCCESS_RATE), names=3)


def _simulated(report: Mapping[str, Any], entry: str) -> dict[str, Mapping[str, Any]]:
    """Return the `entry`, "success" or "reasons", of the simulated methods, ours first."""
    key = {"success": "success_by_friction", "reasons": "success_reasons"}[entry]
    others = report.get("success_baselines", {})
    found = {OURS: report.get(key), **{row: each.get(entry) for row, each in others.items()}}
    return {row: each for row, each in found.items() if each}


def _success_note(by_kind: Mapping[str, Mapping[str, Any]]) -> str:
    if not by_kind:
        return NO_SUCCESS
    trials = {
        kind: max((rate["trials"] for rate in found.values()), default=0)
        for kind, found in by_kind.items()
    }
    counted = ", ".join(f"{kind} {trials[kind]}" for kind in SUCCESS_KINDS if kind in trials)
    return (
        "Rows below: simulation at friction mu of the fingers, with Wilson 95 % intervals, as if "
        f"all trials were independent; trials of SymGrasp: {counted}"
    )


def trial_table(report: Mapping[str, Any]) -> Table | None:
    """Return the outcomes of the simulated trials, in percent; None without trials."""
    cells = [
        (row, key, counts)
        for row, by_split in _simulated(report, "reasons").items()
        for key, counts in by_split.get(ALL, {}).items()
        if sum(counts.values())
    ]
    names = list(dict.fromkeys(name for _, _, counts in cells for name in counts))
    names.sort(key="held".__eq__)  # last, as in the other tables
    body = []
    for row, key, counts in cells:
        shares = (f"{100 * counts.get(n, 0) / sum(counts.values()):.0f}" for n in names)
        body.append((report_row(row).title, key, *shares))
    title = "Outcomes of the simulated trials, percent"
    return Table(title, ("method", "mu", *names), tuple(body), names=2) if body else None


def symmetry_table(report: Mapping[str, Any]) -> Table:
    """Return symmetry AP by method, split and threshold of the dense error."""
    rows: ReportRows = report["rows"]
    paper = published.SYMMETRY_AP
    body = [(method, "test set", *map(_number, found)) for method, found in paper.items()]
    for row, split, figures in _cells(rows):
        if any(value is not None for value in figures["symmetry_ap"].values()):
            found = (
                _number(figures["symmetry_ap"][kind])
                + _between(figures, f"symmetry_ap {kind}", ".2f")
                for kind in SYMMETRY_KINDS
            )
            body.append((report_row(row).title, split, *found))
    for threshold, ap in rows.get(OURS, {}).get(ALL, {}).get("symmetry_ap_strict", {}).items():
        cells = (_number(ap[kind]) if kind != "sphere" else "" for kind in SYMMETRY_KINDS)
        body.append((report_row(OURS).title, f"all, error < {threshold}", *cells))
    note = f"First rows: {published.SOURCE}.{_threshold_note(report)} {interval_note(report)}"
    header = ("method", "split", *SYMMETRY_KINDS)
    return Table("Symmetry, average precision", header, tuple(body), note, len(paper), names=2)


def _threshold_note(report: Mapping[str, Any]) -> str:
    """Return the thresholds of right symmetries in words; empty if the report has no settings."""
    config = mapping_in(mapping_in(report, "provenance"), "config")
    if "symmetry_thresholds" not in config:
        return ""
    first, *others = config["symmetry_thresholds"]
    note = f" A symmetry is right if its dense error is below {first:g}, or a sphere's centre "
    note += f"within {100 * config['sphere_threshold']:g} cm"
    if others:
        kind = "stricter" if max(others) < first else "other"
        note += f"; the last rows have {kind} thresholds"
    return f"{note}."


def graspnet_table(report: Mapping[str, Any]) -> Table | None:
    """Return AP by GraspNet's protocol for each method and split; None for reports without AP."""
    body = tuple(
        (report_row(row).title, split, *(_ap(figures, name) for name in AP_FIGURES))
        for row, split, figures in _cells(report["rows"])
        if figures.get("ap") is not None
    )
    note = (
        "The 50 best grasps of a frame count, at most 10 per object; contacts and collisions are "
        "exact. For graspnetAPI's figures run `symgrasp export`, then `symgrasp evaluate "
        f"--protocol graspnet`. {interval_note(report)}"
    )
    title = "Average precision of grasps by GraspNet's protocol, percent"
    header = ("method", "split", "AP", "AP 0.8", "AP 0.4")
    return Table(title, header, body, note, names=2) if body else None


def _ap(figures: Figures, name: str) -> str:
    return f"{100 * figures[name]:.1f}" + _between(figures, name, ".1f", 100.0)


def mask_table(rows: ReportRows) -> Table:
    """Return the average precision of region masks by split."""
    ((method, figures),) = published.MASK_AP50.items()
    pairs = zip(("seen", "unseen"), figures, strict=True)
    body: list[tuple[str, ...]] = []
    body += [(method, split, _number(figure), "", "") for split, figure in pairs]
    for row, split, found in _cells(rows):
        if row == OURS:
            cells = (_number(found[name]) for name in ("mask_ap50", "mask_ap75", "mask_ap"))
            body.append((report_row(OURS).title, split, *cells))
    note = f"First rows: {published.SOURCE}. AP: mean over overlaps 0.5 to 0.95, by pycocotools."
    header = ("method", "split", "AP50", "AP75", "AP")
    return Table("Average precision of region masks", header, tuple(body), note, 2, names=2)


def reason_table(rows: ReportRows) -> Table:
    """Return the outcomes of the visible objects, in percent of the objects."""
    cells = [cell for cell in _cells(rows) if cell[2]["objects"]]
    reasons = [r for r in REASONS if any(figures["reasons"].get(r) for _, _, figures in cells)]
    body = tuple(
        (report_row(row).title, split, str(figures["objects"]),
         *(f"{100.0 * figures['reasons'].get(r, 0) / figures['objects']:.0f}" for r in reasons))
        for row, split, figures in cells
    )  # fmt: skip
    header = ("method", "split", "objects", *reasons)
    ours = rows.get(OURS, {}).items()
    frames = ", ".join(f"{split} {found['frames']}" for split, found in ours if found["frames"])
    title = "Outcomes of the objects, percent"
    return Table(title, header, body, f"Frames: {frames}." if frames else "", names=2)


def _cells(rows: ReportRows) -> Iterator[tuple[str, str, Figures]]:
    for row, splits in rows.items():
        for split, figures in splits.items():
            if figures["frames"]:
                yield row, split, figures


def _mean(figures: Mapping[str, Figures], name: str, split: str) -> float | None:
    """Return a mean over the objects of a split; `unseen` is its two parts together."""
    parts = [figures[part] for part in (UNSEEN if split == "unseen" else (split,))]
    counted = [(part[name], _count(part, name)) for part in parts if part.get(name) is not None]
    total = sum(count for _, count in counted)
    return sum(mean * count for mean, count in counted) / total if total else None


def _count(figures: Figures, name: str) -> int:
    """Return the number of objects that the mean `name` is over."""
    missing = WITHOUT_GRASP if name.endswith("_predicted") else ()
    return int(figures["objects"] - sum(figures["reasons"].get(reason, 0) for reason in missing))


def _between(figures: Figures, name: str, shown: str = ".3f", scale: float = 1.0) -> str:
    """Return the interval of a figure in brackets; empty if the figure has no interval."""
    ends = figures.get("intervals", {}).get(name)
    return f" ({scale * ends[0]:{shown}} to {scale * ends[1]:{shown}})" if ends else ""


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _rate(found: Mapping[str, Any] | None) -> str:
    if not found or found.get("rate") is None:
        return "-"
    low, high = 100 * found["low"], 100 * found["high"]
    return f"{100 * found['rate']:.0f} ({low:.0f}-{high:.0f})"
