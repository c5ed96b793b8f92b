"""Writing of a report from the records of its scenes: `report.json`, and the page next to it."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipelines.configs import EvaluateConfig
from pipelines.configs.evaluation import BootstrapUnit
from pipelines.evaluation.pages.gallery import FrameChoice, draw_gallery
from pipelines.evaluation.pages.report_page import report_page
from pipelines.evaluation.reports import reports
from pipelines.evaluation.reports.figures import Figures, report_curves, report_rows
from pipelines.evaluation.reports.intervals import RowIntervals
from pipelines.evaluation.reports.tables import TABLE_FRICTION
from pipelines.evaluation.rows import OURS
from pipelines.evaluation.runs.bootstrap_units import UNIT_ENTRY
from pipelines.evaluation.runs.other_runs import ComparedRuns
from pipelines.evaluation.runs.records import FrameRecord
from pipelines.evaluation.runs.run_readers import threshold_keys
from pipelines.evaluation.runs.tallies import ReportTally
from pipelines.storage.files import write_text
from pipelines.storage.provenance import Stamp


def write_report_files(
    output: Path,
    scenes: Iterable[list[FrameRecord]],
    runs: ComparedRuns,
    config: EvaluateConfig,
    stamp: Stamp,
    *,
    unit: BootstrapUnit,
    success: Mapping[str, Mapping[str, Any]],
    failed: Mapping[str, str],
    notes: Mapping[str, str],
    tables: Sequence[Mapping[str, Any]],
) -> dict[str, str]:
    """Write `output` and the page next to it; return the faults of pictures: frame to sentence.

    `scenes`: records of each scene, one scene in memory. `stamp`: of the records, made from `runs`.
    `unit`: of the intervals. `success`: content of a row's `success.json`, by row. `failed`: scene
    that could not be evaluated and is left out, to reason. `notes`: subject to sentence, for
    readers of the report. `tables`: further tables.
    """
    thresholds, sphere = config.symmetry_thresholds, config.sphere_threshold
    tally, choices = ReportTally(), {row: FrameChoice(row) for row in runs.paths}
    intervals = RowIntervals(threshold_keys(thresholds[0], sphere), unit)
    for records in scenes:
        for choice in choices.values():
            choice.add(records)
        for record in records:
            tally.add(record)
            intervals.add(record)
    rows = report_rows(tally, thresholds, sphere)
    intervals.add_to(rows)
    more: dict[str, Any] = {
        UNIT_ENTRY: unit,
        "failed": dict(failed),
        "notes": dict(notes),
        "curves": report_curves(tally, thresholds, sphere),
    }
    if success:
        more |= _add_success(rows, success)
    if tables:
        more["tables"] = list(tables)
    more["seconds_per_frame"] = tally.seconds_per_frame
    reports.write_report(output, rows, stamp, **more)
    gallery, faults = draw_gallery(choices, runs.paths, runs.root)
    write_text(output.with_suffix(".html"), report_page(reports.read_report(output), gallery))
    return faults


def _add_success(
    rows: Mapping[str, Mapping[str, Figures]], success: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Add the success rates at TABLE_FRICTION to the figures of the same row and split.

    Return the rates at all frictions, as entries of the report.
    """
    ours = success.get(OURS, {})
    others = dict(ours.get("baselines", {}))
    for row, found in success.items():
        if row != OURS:
            others[row] = {name: found.get(name, {}) for name in ("success", "reasons")}
    for row, simulated in {OURS: ours, **others}.items():
        for split, figures in rows.get(row, {}).items():
            found = simulated.get("success", {}).get(split, {})
            at = {kind: by_friction.get(TABLE_FRICTION) for kind, by_friction in found.items()}
            figures["success"] = {kind: rate for kind, rate in at.items() if rate is not None}
    return {
        "success_by_friction": ours.get("success", {}),
        "success_reasons": ours.get("reasons", {}),
        "success_baselines": others,
    }
