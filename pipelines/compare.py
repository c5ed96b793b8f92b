"""Stage `compare`: several runs side by side, and the uncertainty of their differences.

Reads   A.json, B.json, ...  reports of `evaluate`, or each a success.json of `simulate`
        A.frames/, ...       the records of each report: A.scenes/ of a dump, A.trials/ of trials
Writes  compare.json or compare.html, if requested

Only frames that all runs contain are compared; other frames are counted. The interval of a
difference to the first run is a paired bootstrap over scenes with all their frames, or over frames.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pipelines.configs import CompareConfig, check_settings
from pipelines.errors import SymgraspError, counted, printable
from pipelines.evaluation.pages.report_page import TEMPLATES
from pipelines.evaluation.reports.figures import TEST_SPLITS
from pipelines.evaluation.reports.tables import Table
from pipelines.evaluation.runs.bootstrap_units import VIEWS_NOTE, bootstrap_units
from pipelines.evaluation.runs.comparison_notes import frame_notes, setting_notes
from pipelines.evaluation.runs.paired_runs import EvaluatedRun, paired_frames
from pipelines.evaluation.runs.run_readers import (
    DEFAULT_ROW,
    compared_folders,
    friction_of,
    read_run,
)
from pipelines.evaluation.runs.tallies import ALL
from pipelines.metrics.paired_bootstrap import FEWEST_UNITS, Difference, differences
from pipelines.pictures.pages import rendered
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage import provenance
from pipelines.storage.files import finite_json, write_json, write_text

FORMAT_VERSION = 1
METRIC_NAMES = {
    "grasp_quality": "grasp quality",
    "antipodal_score": "antipodal, pair",
    "antipodal_score_region": "antipodal, region",
    "share_held": "share held",
    "symmetry_ap reflection": "AP reflection",
    "symmetry_ap rotation": "AP rotation",
    "symmetry_ap sphere": "AP sphere",
    "mask_ap50": "mask AP50",
    "ap": "AP",
    "ap_0.8": "AP 0.8",
    "ap_0.4": "AP 0.4",
}


@dataclass(frozen=True)
class Figure:
    """One metric in one split: the value of each run, and the differences to the first."""

    metric: str
    split: str
    frames: int
    values: list[float]
    differences: list[Difference]


@dataclass(frozen=True)
class Comparison:
    """Result of a comparison: names of the runs, remarks on their differences, figures."""

    runs: list[str]
    notes: list[str]
    figures: list[Figure]
    config: CompareConfig


@one_run_at_a_time("compare", "output")
def run(
    reports: Sequence[Path],
    config: CompareConfig,
    output: Path | None = None,
    *,
    seed: int = 0,
    overwrite: bool = False,
) -> Comparison:
    """Compare `reports` with the first of them and write `output`, .json or .html, if given.

    Raises:
        SymgraspError: runs that cannot be paired.
        ValueRangeError: `output` is one of `reports`.
    """
    check_settings(config)
    stamp = provenance.make_stamp("compare", config, seed=seed, inputs=_digests(reports))
    if output is not None:
        provenance.refuse_own_input(output, reports)
        provenance.refuse_foreign(output, "compare")
        # refuses to replace another comparison
        provenance.is_finished(output, stamp, overwrite=overwrite)
    names = run_names(reports)
    runs = [read_run(path, name, config.row) for path, name in zip(reports, names, strict=True)]
    found = compared(runs, config, seed)
    if output is not None:
        _write(output, found, reports, stamp)
    return found


def compared(runs: Sequence[EvaluatedRun], config: CompareConfig, seed: int) -> Comparison:
    """Return the differences of `runs` on the frames that all runs contain.

    Raises:
        SymgraspError: runs that cannot be paired, or without a figure.
    """
    paired = set(paired_frames(runs))
    notes = [*frame_notes(runs, len(paired)), *setting_notes(runs, config.row)]
    figures = []
    for metric in _shared_metrics(runs):
        for split in (ALL, "train", *TEST_SPLITS):
            names = [name for name in runs[0].names_in(split) if name in paired]
            if not names:
                continue
            each = [run.figure(metric, names) for run in runs]
            group = bootstrap_units(names, config.unit)
            values, found = differences(each, group, config.resamples, config.level, seed)
            if any(map(math.isfinite, values)):
                figures.append(Figure(metric, split, len(names), values, found))
    if not figures:
        raise SymgraspError(
            f"no figure is defined on the {counted(len(paired), 'frame')} that all runs contain, "
            "without any object to grasp; compare runs on other frames"
        )
    return Comparison([run.name for run in runs], notes, figures, config)


def _shared_metrics(runs: Sequence[EvaluatedRun]) -> list[str]:
    """Return the metrics that all runs contain, in the order of the tables."""
    shared = set.intersection(*(run.metrics for run in runs))
    simulated = shared - set(METRIC_NAMES)
    return [*filter(shared.__contains__, METRIC_NAMES), *sorted(simulated, key=friction_of)]


def tables(comparison: Comparison) -> list[Table]:
    """Return a table per split: the value of each run, then its difference to the first run."""
    first, *others = comparison.runs
    config = comparison.config
    header = ["", first]
    for name in others:
        header += [name, "difference", f"{100 * config.level:g} % interval"]
    found = []
    for split in dict.fromkeys(figure.split for figure in comparison.figures):
        figures = [figure for figure in comparison.figures if figure.split == split]
        title = f"{split}: {counted(figures[0].frames, 'frame')} in common"
        if config.unit == "scene":
            title += f", {counted(figures[0].differences[0].units, 'scene')}"
        title += f", row `{config.row}`" if config.row != DEFAULT_ROW else ""
        found.append(Table(title, tuple(header), tuple(map(_row, figures))))
    note = (
        f"Differences to {first}; intervals by paired bootstrap over {config.unit}s, "
        f"{config.resamples} draws; a single {config.unit} has none; * excludes zero, over at "
        f"least {FEWEST_UNITS} {config.unit}s."
    )
    note += f" {VIEWS_NOTE}" if config.unit == "frame" else ""
    return [*found[:-1], replace(found[-1], note=note)]


def run_names(reports: Sequence[Path]) -> list[str]:
    """Return short, printable, distinct names of `reports`, without the end that all paths share.

    Raises:
        SymgraspError: a report is given twice.
    """
    parts = [path.absolute().with_suffix("").parts for path in reports]
    if len(set(parts)) < len(parts):
        raise SymgraspError("a report is given twice; name each once")
    end = 0
    while len({each[-end - 1] for each in parts}) == 1:
        end += 1
    length = 1
    while len({each[: len(each) - end][-length:] for each in parts}) < len(parts):
        length += 1
    return [printable("/".join(each[: len(each) - end][-length:])) for each in parts]


def _digests(reports: Sequence[Path]) -> dict[str, str]:
    digests = {}
    for place, path in enumerate(reports):
        digests[f"report {place}"] = provenance.digest(path) if path.is_file() else ""
        for folder in compared_folders(path):
            digests[f"{folder.suffix[1:]} {place}"] = provenance.digest_folder(folder, "*")
    return digests


def _write(
    output: Path, found: Comparison, reports: Sequence[Path], stamp: provenance.Stamp
) -> None:
    if output.suffix == ".html":
        title = f"SymGrasp: {' and '.join(found.runs)}"
        template = TEMPLATES / "comparison.html"
        page = rendered(template, title=title, notes=found.notes, tables=tables(found))
        provenance.stamp_ahead(output, stamp)
        write_text(output, page)
        return
    figures: dict[str, dict[str, Any]] = {}
    for figure in found.figures:
        figures.setdefault(figure.split, {})[figure.metric] = {
            "frames": figure.frames,
            "values": figure.values,
            "differences": [asdict(difference) for difference in figure.differences],
        }
    runs = zip(found.runs, reports, strict=True)
    content = {
        "runs": [{"name": name, "report": printable(str(path))} for name, path in runs],
        "row": found.config.row,
        "notes": found.notes,
        "figures": figures,
        "format_version": FORMAT_VERSION,
        "provenance": stamp.as_json(),
    }
    write_json(output, finite_json(content))


def _number(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "-"


def _row(figure: Figure) -> tuple[str, ...]:
    name = METRIC_NAMES.get(figure.metric) or f"success, mu {friction_of(figure.metric):g}"
    row = [name, _number(figure.values[0])]
    for value, difference in zip(figure.values[1:], figure.differences, strict=True):
        row += [_number(value), *_words(difference)]
    return tuple(row)


def _words(difference: Difference) -> tuple[str, str]:
    if not math.isfinite(difference.value):
        return "-", "-"
    if not math.isfinite(difference.low):  # a single frame or scene, or undefined in most draws
        return f"{difference.value:+.3f}", "-"
    mark = " *" if difference.is_certain else ""
    return f"{difference.value:+.3f}", f"{difference.low:+.3f} to {difference.high:+.3f}{mark}"
