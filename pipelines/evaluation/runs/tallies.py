"""Frame records added up: the few bytes of each prediction that the figures need.

So any number of frames fits in memory: records are read one scene at a time.
"""

from array import array
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.evaluation.runs.records import FrameRecord, RowRecord, ScoredPredictions
from pipelines.metrics.graspnet.graspnet_ap import AP_FRICTIONS
from pipelines.metrics.symmetry_matching import CORRECT, IGNORED

ALL = "all"
WITHOUT_GRASP = ("no region", "no grasp")


def _floats() -> "array[float]":
    return array("d")


@dataclass
class PredictionTally:
    """Predictions of one kind in many frames; fields as in `ScoredPredictions`."""

    num_truth: int = 0
    confidence: "array[float]" = field(default_factory=_floats)
    verdicts: dict[str, "array[int]"] = field(default_factory=dict)

    def add(self, scored: ScoredPredictions) -> None:
        """Add the predictions of one frame."""
        self.num_truth += scored.num_truth
        self.confidence.extend(scored.confidence)
        for key, verdicts in scored.verdicts.items():
            self.verdicts.setdefault(key, array("b")).extend(verdicts)

    def pooled(self, key: str) -> tuple[Array, Mask, int]:
        """Return confidences (p,), correctness (p,), and the number of true ones."""
        verdicts = np.array(self.verdicts.get(key, []), np.int8)
        counted = verdicts != IGNORED
        confidence = np.array(self.confidence, np.float64)[: len(counted)]
        return confidence[counted], verdicts[counted] == CORRECT, self.num_truth


@dataclass
class RowTally:
    """One method on many frames; arrays have one entry per visible object and frame.

    `held_friction`: smallest friction that holds; inf where the grasp fails for any reason.
    `predicted`: 1 where there was a grasp to evaluate. `symmetries`: by kind. `accuracy`: (6,) sums
    over `with_accuracy` frames at each of `AP_FRICTIONS`, by GraspNet's protocol. `masks`: of the
    regions that are grasped, in `with_masks` frames.
    """

    frames: int = 0
    quality: "array[float]" = field(default_factory=_floats)
    antipodal: "array[float]" = field(default_factory=_floats)
    antipodal_region: "array[float]" = field(default_factory=_floats)
    held_friction: "array[float]" = field(default_factory=_floats)
    predicted: "array[int]" = field(default_factory=lambda: array("b"))
    reasons: Counter[str] = field(default_factory=Counter)
    symmetries: defaultdict[str, PredictionTally] = field(
        default_factory=lambda: defaultdict(PredictionTally)
    )
    accuracy: Array = field(default_factory=lambda: np.zeros(len(AP_FRICTIONS)))
    with_accuracy: int = 0
    masks: PredictionTally = field(default_factory=PredictionTally)
    with_masks: int = 0

    def add(self, row: RowRecord, masks: ScoredPredictions | None) -> None:
        """Add the record of one frame, and the `masks` that the row grasps, if it has any."""
        self.frames += 1
        for verdict in row.verdicts:
            held = verdict.reason == "held"
            self.quality.append(verdict.quality)
            self.antipodal.append(verdict.antipodal)
            self.antipodal_region.append(verdict.antipodal_region)
            self.held_friction.append(verdict.min_friction if held else float("inf"))
            self.predicted.append(verdict.reason not in WITHOUT_GRASP)
            self.reasons[verdict.reason] += 1
        for kind, scored in row.symmetries.items():
            self.symmetries[kind].add(scored)
        if row.accuracy:
            self.accuracy += row.accuracy
            self.with_accuracy += 1
        if masks is not None:
            self.masks.add(masks)
            self.with_masks += 1


@dataclass
class ReportTally:
    """All methods on many frames, by split; the split `all` holds every frame.

    `seconds`: run times of `infer`, of frames with a known time. `rows`: by method and split.
    """

    seconds: "array[float]" = field(default_factory=_floats)
    rows: dict[str, defaultdict[str, RowTally]] = field(default_factory=dict)

    @property
    def seconds_per_frame(self) -> float | None:
        """Median of `seconds`, because the first frames of a run wait for compilation."""
        return float(np.median(self.seconds)) if self.seconds else None

    @classmethod
    def of(cls, records: Iterable[FrameRecord]) -> "ReportTally":
        """Return the tally of `records`."""
        tally = cls()
        for record in records:
            tally.add(record)
        return tally

    def add(self, record: FrameRecord) -> None:
        """Add one frame's record."""
        if np.isfinite(record.seconds):
            self.seconds.append(record.seconds)
        for name, row in record.rows.items():
            for split in (record.split, ALL):
                tally = self.rows.setdefault(name, defaultdict(RowTally))[split]
                tally.add(row, record.masks_of(name))
