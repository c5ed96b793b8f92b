"""The records of several runs, frame by frame, and which of their frames can be paired.

Frames are paired by name. Two runs were judged against the same truth if a frame has the same
visible objects and as many masks and symmetries to find in both; runs of which this is not so
cannot be paired at all.
"""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError, MissingInputError, SymgraspError, UnknownNameError
from pipelines.evaluation.records import (
    FrameRecord,
    JudgedPredictions,
    RowRecord,
    read_records,
    records_folder,
    threshold_key,
)
from pipelines.evaluation.tallies import ALL
from pipelines.formats import reports
from pipelines.formats.provenance import COMPARED, read_stamp
from pipelines.metrics.coco_masks import IOU_THRESHOLDS
from pipelines.metrics.paired_bootstrap import FrameFigure, FrameMeans, FramePrecision
from pipelines.metrics.symmetry_matching import CORRECT, IGNORED, KINDS

MEANS = ("grasp_quality", "antipodal_score", "antipodal_score_region", "share_held")
MASKS = "mask_ap50"
PRECISIONS = (*(f"symmetry_ap {kind}" for kind in KINDS), MASKS)
METRICS = (*MEANS, *PRECISIONS)

Truth = tuple[tuple[int, ...], int, tuple[int, ...]]  # visible objects, masks, symmetries by kind


@dataclass
class Judged:
    """Predictions of one kind in the frames of a run, in the order of the frames."""

    confidence: "array[float]" = field(default_factory=lambda: array("d"))
    correct: "array[int]" = field(default_factory=lambda: array("b"))
    frame: "array[int]" = field(default_factory=lambda: array("q"))
    num_truth: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, frame: int, judged: JudgedPredictions | None, key: str) -> None:
        """Add one frame's; None where the method predicts none of the kind."""
        found = judged or JudgedPredictions(0)
        self.num_truth.append(found.num_truth)
        for confidence, verdict in zip(
            found.confidence, found.verdicts.get(key, []), strict=bool(found.verdicts)
        ):
            if verdict != IGNORED:
                self.confidence.append(confidence)
                self.correct.append(verdict == CORRECT)
                self.frame.append(frame)

    def at(self, places: NDArray[np.int64], *, coco: bool) -> FramePrecision:
        """Return the average precision over the frames at `places`, in that order."""
        new = np.full(len(self.num_truth), -1, np.int64)
        new[places] = np.arange(len(places))
        frame = new[np.array(self.frame, np.int64)]
        kept = frame >= 0
        # In the order of the frames, so that equal confidences rank alike in all runs.
        order = np.argsort(frame[kept], kind="stable")
        confidence, correct = np.array(self.confidence)[kept], np.array(self.correct, bool)[kept]
        truths = np.array(self.num_truth)[places]
        return FramePrecision.ranked(
            confidence[order], correct[order], frame[kept][order], truths, coco=coco
        )


@dataclass
class Run:
    """One row of one report, frame by frame.

    Attributes:
        name: short, other than those of the runs beside it.
        report: the content of `report.json`.
        frames: name to place.
        splits, truth: of each frame.
        sums: by metric of MEANS, of each frame the sum over its objects.
        judged: by metric of PRECISIONS.
    """

    name: str
    report: Mapping[str, Any]
    frames: dict[str, int] = field(default_factory=dict)
    splits: list[str] = field(default_factory=list)
    truth: list[Truth] = field(default_factory=list)
    sums: dict[str, "array[float]"] = field(
        default_factory=lambda: {name: array("d") for name in MEANS}
    )
    judged: dict[str, Judged] = field(
        default_factory=lambda: {name: Judged() for name in PRECISIONS}
    )

    def add(self, record: FrameRecord, row: RowRecord, keys: Mapping[str, str]) -> None:
        """Add one frame; `keys` name the threshold of each metric of PRECISIONS."""
        place = self.frames.setdefault(record.name, len(self.frames))
        self.splits.append(record.split)
        symmetries = [row.symmetries.get(kind) for kind in KINDS]
        self.truth.append(
            (
                tuple(sorted(verdict.object_id for verdict in row.verdicts)),
                record.masks.num_truth,
                tuple(judged.num_truth if judged else 0 for judged in symmetries),
            )
        )
        values = {
            "grasp_quality": [verdict.quality for verdict in row.verdicts],
            "antipodal_score": [verdict.antipodal for verdict in row.verdicts],
            "antipodal_score_region": [verdict.antipodal_region for verdict in row.verdicts],
            "share_held": [float(verdict.reason == "held") for verdict in row.verdicts],
        }
        for name in MEANS:
            self.sums[name].append(float(np.sum(values[name])))
        for name, judged in zip(PRECISIONS, (*symmetries, record.masks), strict=True):
            self.judged[name].add(place, judged, keys[name])

    def figure(self, metric: str, names: Sequence[str]) -> FrameFigure:
        """Return `metric` over the frames called `names`, in that order."""
        places = np.array([self.frames[name] for name in names], np.int64)
        if metric in MEANS:
            counts = np.array([len(self.truth[place][0]) for place in places], np.float64)
            return FrameMeans(np.array(self.sums[metric])[places], counts)
        return self.judged[metric].at(places, coco=metric == MASKS)

    def names_in(self, split: str) -> list[str]:
        """Return the names of the frames of a split, sorted."""
        return sorted(n for n, place in self.frames.items() if split in (ALL, self.splits[place]))


def read_run(path: Path, name: str, row: str) -> Run:
    """Read the records beside the report `path`, a scene at a time.

    Raises:
        MissingInputError: there are none.
        FormatError: they were made otherwise than the report.
        UnknownNameError: the report has no such row.
    """
    report = reports.read_report(path)
    if row not in report["rows"]:
        raise UnknownNameError(f"row of {path}", row, report["rows"])
    stamp = report.get("provenance") or {}
    scenes = sorted(records_folder(path).glob("[!.]*.json"))
    if not scenes:
        raise MissingInputError(records_folder(path), "symgrasp evaluate")
    run, keys = Run(name, report), _threshold_keys(path, stamp)
    for scene in scenes:
        found = read_stamp(scene) or {}
        if any(found.get(key) != stamp.get(key) for key in COMPARED):
            expected = "run evaluate again, both come from one run"
            raise FormatError(scene, f"was made otherwise than {path.name}", expected)
        for record in read_records(scene):
            if row in record.rows:
                run.add(record, record.rows[row], keys)
    return run


def _threshold_keys(path: Path, stamp: Mapping[str, Any]) -> dict[str, str]:
    """Return the threshold at which each metric of PRECISIONS is compared: the reported one."""
    try:
        dense = threshold_key(stamp["config"]["symmetry_thresholds"][0])
        sphere = threshold_key(stamp["config"]["sphere_threshold"])
    except (KeyError, IndexError, TypeError) as error:
        expected = "a report of `symgrasp evaluate` is expected"
        raise FormatError(path, "does not say its thresholds", expected) from error
    keys = [sphere if kind == "sphere" else dense for kind in KINDS]
    return dict(zip(PRECISIONS, (*keys, threshold_key(IOU_THRESHOLDS[0])), strict=True))


def paired_frames(runs: Sequence[Run]) -> list[str]:
    """Return the names of the frames that all runs have, sorted.

    Raises:
        SymgraspError: there is none, or a frame has another truth in one run than in another.
    """
    first, *others = runs
    for other in others:
        common = sorted(first.frames.keys() & other.frames.keys())
        if not common:
            raise SymgraspError(
                f"{first.name} and {other.name} have no frame in common; "
                "runs are paired by the names of their frames"
            )
        for name in common:
            _check_truth(name, first, other)
    shared = set(first.frames).intersection(*(other.frames for other in others))
    if not shared:
        raise SymgraspError("no frame is in all of the runs; compare fewer of them")
    return sorted(shared)


def _check_truth(name: str, first: Run, other: Run) -> None:
    one, two = first.truth[first.frames[name]], other.truth[other.frames[name]]
    if one == two:
        return
    what = "visible objects" if one[0] != two[0] else "masks or symmetries to find"
    raise SymgraspError(
        f"{name} has other {what} in {other.name} than in {first.name}: judged on another dataset, "
        "with other labels or other settings, these runs cannot be paired"
    )
