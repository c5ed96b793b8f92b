"""Paired bootstrap over frames or scenes: the certainty of a difference between two runs.

A resample draws as many frames (or scenes, with all their frames) as there are, with repetition.
All runs are computed on the same draw, so the difficulty that a frame has for all runs cancels.
A draw is one weight per frame, the number of times it was drawn. Every figure takes weights, so
that no frame is copied.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from pipelines.array_types import Array, Mask
from pipelines.metrics.average_precision import last_equals

COCO_RECALLS = np.linspace(0.0, 1.0, 101)
FEWEST_UNITS = 6  # frames or scenes that all differ alike by a chance below 5 %
LEAST_WIDTH = 1e-9  # of an interval; draws of equal frames differ by rounding
LARGEST_BLOCK = 4_000_000  # weights of predictions in memory at a time
LARGEST_DRAW = 64  # draws that are computed together


@dataclass(frozen=True)
class FrameMeans:
    """A mean over objects: of f frames, the `sums` (f,) over objects, and their `counts` (f,)."""

    sums: Array
    counts: Array

    def at(self, weights: Array) -> Array:
        """Return (b,) the means of `weights` (b, f); nan without objects."""
        with np.errstate(invalid="ignore"):
            return np.asarray((weights @ self.sums) / (weights @ self.counts))


@dataclass(frozen=True)
class FramePrecision:
    """An average precision: p predictions of f frames, the most confident first."""

    correct: Array  # (p,) 1 right, 0 wrong
    frame: NDArray[np.int64]  # (p,) index of the prediction's frame
    num_truth: Array  # (f,) number of true ones to find
    last: NDArray[np.int64]  # (p,) place of the last equal confidence; with COCO each its own place
    coco: bool = False  # COCO's mean over 101 recalls, not the area under all points

    @classmethod
    def ranked(
        cls,
        confidence: Array,
        correct: Mask,
        frame: NDArray[np.int64],
        num_truth: Array,
        *,
        coco: bool = False,
    ) -> "FramePrecision":
        """Return the figure of p predictions in any order; with COCO the order breaks ties.

        `confidence`: (p,). Other arguments as the attributes.
        """
        order = np.argsort(-confidence, kind="stable")
        last = np.arange(len(order)) if coco else last_equals(confidence[order])
        return cls(correct[order].astype(np.float64), frame[order], num_truth, last, coco)

    def at(self, weights: Array) -> Array:
        """Return (b,) the average precisions of `weights` (b, f); nan without any truth."""
        size = max(1, LARGEST_BLOCK // max(len(self.frame), 1))
        blocks = [self._at(weights[i : i + size]) for i in range(0, len(weights), size)]
        return np.concatenate(blocks)

    def _at(self, weights: Array) -> Array:
        total = weights @ self.num_truth
        counted = weights[:, self.frame]
        right = np.cumsum(counted * self.correct, axis=1)
        precision = (right / np.maximum(np.cumsum(counted, axis=1), 1.0))[:, self.last]
        best = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
        with np.errstate(invalid="ignore", divide="ignore"):
            if not self.coco:
                return np.asarray((counted * self.correct * best).sum(axis=1) / total)
            recall = right / total[:, None]
        means = [
            np.append(row, 0.0)[np.searchsorted(reached, COCO_RECALLS, side="left")].mean()
            for row, reached in zip(best, recall, strict=True)
        ]
        return np.where(total > 0, means, np.nan)


FrameFigure = FrameMeans | FramePrecision


@dataclass(frozen=True)
class Difference:
    """A figure minus the figure of the first run, with an interval; nan if undefined.

    `units`: number of frames or scenes that are drawn from.
    """

    value: float
    low: float
    high: float
    units: int

    @property
    def is_certain(self) -> bool:
        """Whether the interval leaves out zero, and there are at least `FEWEST_UNITS` units.

        Fewer units may all differ alike by chance more often than the interval allows.
        """
        return self.units >= FEWEST_UNITS and (self.low > 0.0 or self.high < 0.0)


def draws(num_drawn: int, resamples: int, rng: np.random.Generator) -> Iterator[Array]:
    """Yield blocks (b, g) of weights of frames or scenes, `resamples` rows in all."""
    size = max(1, min(LARGEST_DRAW, LARGEST_BLOCK // num_drawn))
    share = np.full(num_drawn, 1.0 / num_drawn)
    for start in range(0, resamples, size):
        rows = min(size, resamples - start)
        yield rng.multinomial(num_drawn, share, size=rows).astype(np.float64)


def differences(
    figures: list[FrameFigure], group: NDArray[np.int64], resamples: int, level: float, seed: int
) -> tuple[list[float], list[Difference]]:
    """Return each run's figure on all frames, and the differences of the other runs to the first.

    `figures`: over the same frames in the same order. `group`: (f,) index 0, 1, ... of the unit
    that each frame is drawn with: the frame itself, or its scene. `level`: share of the `resamples`
    draws inside the interval. The same `seed` draws the same frames.
    """
    values = [float(figure.at(np.ones((1, len(group))))[0]) for figure in figures]
    units = int(group.max(initial=-1)) + 1
    if units < 2:  # a single unit does not show the spread
        return values, [Difference(v - values[0], np.nan, np.nan, units) for v in values[1:]]
    blocks = draws(units, resamples, np.random.default_rng(seed))
    drawn = np.hstack([np.stack([figure.at(w[:, group]) for figure in figures]) for w in blocks])
    found = []
    for value, row in zip(values[1:], drawn[1:] - drawn[0], strict=True):
        found.append(Difference(value - values[0], *_ends(row, level, units), units))
    return values, found


def interval(
    figure: FrameFigure, group: NDArray[np.int64], resamples: int, level: float, seed: int
) -> tuple[float, float]:
    """Return the ends of the interval of one figure; nan if undefined. Arguments as `differences`.

    An interval of fewer than `FEWEST_UNITS` units would be too narrow, and is nan; so is one
    without width: units that are all alike, as eight true spheres all found, show no spread.
    """
    units = int(group.max(initial=-1)) + 1
    if units < FEWEST_UNITS:
        return np.nan, np.nan
    blocks = draws(units, resamples, np.random.default_rng(seed))
    drawn = np.concatenate([figure.at(weights[:, group]) for weights in blocks])
    low, high = _ends(drawn, level, units)
    return (low, high) if high - low > LEAST_WIDTH else (np.nan, np.nan)


def _ends(drawn: Array, level: float, units: int) -> tuple[float, float]:
    defined = drawn[np.isfinite(drawn)]  # a draw may hold no truth at all
    if 2 * len(defined) < len(drawn):
        return np.nan, np.nan
    low, high = np.percentile(defined, _percentiles(level, units))
    return float(low), float(high)


def _percentiles(level: float, units: int) -> tuple[float, float]:
    """Return the percentiles of draws of `units` frames or scenes that enclose a share `level`.

    Draws from few units vary too little, by the root of (n - 1) / n, and have too short tails:
    expanded percentiles reach as far out as Student's t (T. Hesterberg, What Teachers Should Know
    About the Bootstrap, 2015).
    """
    far = stdtrit(units - 1, 0.5 * (1.0 + level)) * np.sqrt(units / (units - 1))
    share = float(ndtr(far))
    return 100.0 * (1.0 - share), 100.0 * share
