"""Intervals of a report's figures: a bootstrap over scenes or frames, by row and split."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from pipelines.configs.evaluation import BootstrapUnit
from pipelines.evaluation.reports.figures import Figures
from pipelines.evaluation.runs.bootstrap_units import bootstrap_units
from pipelines.evaluation.runs.paired_runs import EvaluatedRun
from pipelines.evaluation.runs.records import FrameRecord
from pipelines.evaluation.runs.run_readers import add_record
from pipelines.metrics.paired_bootstrap import FrameFigure, FramePrecision, interval

RESAMPLES, FEWEST_RESAMPLES = 1000, 100
LEVEL = 0.95
MOST_WEIGHTS = 100_000_000  # of predictions that are drawn for one interval


@dataclass
class RowIntervals:
    """Frames of a report by row; `keys` are the result of `threshold_keys`."""

    keys: Mapping[str, str]
    unit: BootstrapUnit
    runs: dict[str, EvaluatedRun] = field(default_factory=dict)

    def add(self, record: FrameRecord) -> None:
        """Add one frame."""
        for name in record.rows:
            add_record(self.runs.setdefault(name, EvaluatedRun(name, {})), record, name, self.keys)

    def add_to(self, rows: Mapping[str, Mapping[str, Figures]]) -> None:
        """Add `intervals` to the figures of each row and split: low and high end by metric."""
        for name, splits in rows.items():
            for split, figures in splits.items():
                figures["intervals"] = self._intervals(name, split)

    def _intervals(self, row: str, split: str) -> dict[str, tuple[float, float]]:
        run = self.runs[row]
        frames = run.names_in(split)
        group = bootstrap_units(frames, self.unit)
        found = {}
        for metric in sorted(run.metrics):
            figure = run.figure(metric, frames)
            ends = interval(figure, group, _resamples(figure), LEVEL, seed=0)
            if all(map(math.isfinite, ends)):
                found[metric] = ends
        return found


def _resamples(figure: FrameFigure) -> int:
    """Return the number of draws: fewer where there are very many predictions."""
    if not isinstance(figure, FramePrecision):
        return RESAMPLES
    return max(FEWEST_RESAMPLES, min(RESAMPLES, MOST_WEIGHTS // max(len(figure.frame), 1)))
