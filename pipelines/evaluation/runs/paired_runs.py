"""Several runs frame by frame, and the pairing of their frames.

Frames are paired by name. Two runs were evaluated on the same truth if each frame has the same
visible objects and the same numbers of masks and symmetries to find in both; other runs cannot be
paired at all. The truth of a method without symmetries has no numbers of symmetries.
"""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import SymgraspError
from pipelines.evaluation.runs.records import ScoredPredictions
from pipelines.evaluation.runs.tallies import ALL
from pipelines.metrics.graspnet.graspnet_ap import AP_FIGURES
from pipelines.metrics.paired_bootstrap import FrameFigure, FrameMeans, FramePrecision
from pipelines.metrics.symmetry_matching import CORRECT, IGNORED

MASKS = "mask_ap50"

Truth = tuple[tuple[int, ...], int, tuple[int, ...]]  # visible objects, masks, symmetries by kind


@dataclass
class RunPredictions:
    """Predictions of one kind in the frames of a run, in the order of the frames."""

    confidence: "array[float]" = field(default_factory=lambda: array("d"))
    correct: "array[int]" = field(default_factory=lambda: array("b"))
    frame: "array[int]" = field(default_factory=lambda: array("q"))
    num_truth: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, frame: int, scored: ScoredPredictions, key: str) -> None:
        """Add the predictions of one frame."""
        self.num_truth.append(scored.num_truth)
        for confidence, verdict in zip(
            scored.confidence, scored.verdicts.get(key, []), strict=bool(scored.verdicts)
        ):
            if verdict != IGNORED:
                self.confidence.append(confidence)
                self.correct.append(verdict == CORRECT)
                self.frame.append(frame)

    def at(self, places: NDArray[np.int64], *, coco: bool) -> FramePrecision:
        """Return the average precision over the frames at `places` (k,), in that order."""
        new = np.full(len(self.num_truth), -1, np.int64)
        new[places] = np.arange(len(places))
        frame = new[np.array(self.frame, np.int64)]
        kept = frame >= 0
        # The order of the frames ranks COCO's equal confidences alike in all runs.
        order = np.argsort(frame[kept], kind="stable")
        confidence, correct = np.array(self.confidence)[kept], np.array(self.correct, bool)[kept]
        truths = np.array(self.num_truth)[places]
        return FramePrecision.ranked(
            confidence[order], correct[order], frame[kept][order], truths, coco=coco
        )


@dataclass
class EvaluatedRun:
    """One row of one report, frame by frame.

    `counts`: number of objects (or other items of the means) in each frame. `sums`: by metric that
    is a mean, the sum over the objects of each frame; for `AP_FIGURES` the figure of the frame.
    `predictions`: by metric that is an average precision over all frames.
    """

    name: str  # short, and different from the names of the other runs
    report: Mapping[str, Any]  # the content of `report.json` or `success.json`
    frames: dict[str, int] = field(default_factory=dict)  # name to place
    splits: list[str] = field(default_factory=list)  # of each frame
    truth: list[Truth] = field(default_factory=list)  # of each frame
    counts: "array[float]" = field(default_factory=lambda: array("d"))
    sums: dict[str, "array[float]"] = field(default_factory=dict)
    predictions: dict[str, RunPredictions] = field(default_factory=dict)

    @property
    def metrics(self) -> set[str]:
        """Metrics by which this run can be compared: those that all frames have."""
        found = {name: len(sums) for name, sums in self.sums.items()}
        found |= {name: len(each.num_truth) for name, each in self.predictions.items()}
        return {name for name, frames in found.items() if frames == len(self.counts)}

    def add(
        self, name: str, split: str, truth: Truth, count: int, sums: Mapping[str, float]
    ) -> int:
        """Add one frame; return its place."""
        place = self.frames.setdefault(name, len(self.frames))
        if place < len(self.splits):
            raise SymgraspError(f"{self.name} holds the frame {name} twice; evaluate it again")
        self.splits.append(split)
        self.truth.append(truth)
        self.counts.append(count)
        for metric, value in sums.items():
            self.sums.setdefault(metric, array("d")).append(value)
        return place

    def figure(self, metric: str, names: Sequence[str]) -> FrameFigure:
        """Return `metric` over the frames `names`, in that order."""
        places = np.array([self.frames[name] for name in names], np.int64)
        if metric in self.sums:
            sums, counts = np.array(self.sums[metric])[places], np.array(self.counts)[places]
            return FrameMeans(sums, np.ones_like(counts) if metric in AP_FIGURES else counts)
        return self.predictions[metric].at(places, coco=metric == MASKS)

    def names_in(self, split: str) -> list[str]:
        """Return the names of the frames of a split, sorted."""
        return sorted(n for n, place in self.frames.items() if split in (ALL, self.splits[place]))


def paired_frames(runs: Sequence[EvaluatedRun]) -> list[str]:
    """Return the names of the frames that all runs have, sorted.

    Raises:
        SymgraspError: no frame or metric is in all runs, or a frame's truth differs between runs.
    """
    first, *others = runs
    protocols = {run.report.get("protocol") for run in runs}
    if len(protocols) > 1 or not set.intersection(*(run.metrics for run in runs)):
        raise SymgraspError(
            "the runs have different protocols or different frictions, so no figure is common; "
            "compare runs of one kind"
        )
    for other in others:
        common = sorted(first.frames.keys() & other.frames.keys())
        if not common:
            raise SymgraspError(
                f"{first.name} and {other.name} have no frame in common; "
                "runs are paired by the names of their frames"
            )
        for name in common:
            one, two = first.truth[first.frames[name]], other.truth[other.frames[name]]
            if not _is_same(one, two):
                differing = "visible objects" if one[0] != two[0] else "masks or symmetries to find"
                raise SymgraspError(
                    f"{name} has other {differing} in {other.name} than in {first.name}; "
                    "evaluate both on one dataset, with the same labels and settings"
                )
    shared = set(first.frames).intersection(*(other.frames for other in others))
    if not shared:
        raise SymgraspError("no frame is in all of the runs; compare fewer of them")
    return sorted(shared)


def _is_same(one: Truth, two: Truth) -> bool:
    """Return whether two runs had one truth, as far as a method without symmetries shows it."""
    return one[:2] == two[:2] and (one[2] == two[2] or () in (one[2], two[2]))
