"""Precision, recall and average precision from predictions with confidences.

Predictions are matched to the truth one to one, the most confident first; a second prediction of
a truth already taken is wrong. Average precision is the whole area under the precision-recall
curve (all points), or COCO's mean over 101 recalls.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

COCO_RECALLS = np.linspace(0.0, 1.0, 101)


@dataclass(frozen=True)
class PrecisionRecallCurve:
    """One point a prediction, from the most confident to the least.

    Attributes:
        confidence: (p,) falling.
        recall: (p,) rising; nan if there is no truth.
        precision: (p,).
    """

    confidence: Array
    recall: Array
    precision: Array


def match_greedy(confidence: ArrayLike, misfit: ArrayLike) -> NDArray[np.int64]:
    """Return (p,) the truth each prediction takes, -1 for none.

    Args:
        confidence: (p,) of the predictions; equal ones go in the given order.
        misfit: (p, t), lower is better, inf where the pair is no match.
    """
    costs = np.array(misfit, np.float64)
    taken = np.full(len(costs), -1, np.int64)
    if costs.size == 0:
        return taken
    for prediction in np.argsort(-np.asarray(confidence, np.float64), kind="stable"):
        truth = int(np.argmin(costs[prediction]))
        if np.isfinite(costs[prediction, truth]):
            taken[prediction] = truth
            costs[:, truth] = np.inf
    return taken


def precision_recall(
    confidence: ArrayLike, correct: ArrayLike, num_truth: int
) -> PrecisionRecallCurve:
    """Return the curve of predictions (p,) that are `correct` (p,) or not, of `num_truth`."""
    falling = np.asarray(confidence, np.float64)
    order = np.argsort(-falling, kind="stable")
    hits = np.cumsum(np.asarray(correct, np.bool_)[order])
    recall = hits / num_truth if num_truth else np.full(len(hits), np.nan)
    return PrecisionRecallCurve(falling[order], recall, hits / np.arange(1, len(hits) + 1))


def average_precision(confidence: ArrayLike, correct: ArrayLike, num_truth: int) -> float:
    """Return the area under the precision-recall curve, all points; nan without any truth."""
    if num_truth == 0:
        return float("nan")
    curve = precision_recall(confidence, correct, num_truth)
    steps = np.diff(curve.recall, prepend=0.0)
    return float(steps @ _envelope(curve.precision))


def coco_average_precision(confidence: ArrayLike, correct: ArrayLike, num_truth: int) -> float:
    """Return COCO's average precision, the mean precision at 101 recalls; nan without truth."""
    if num_truth == 0:
        return float("nan")
    curve = precision_recall(confidence, correct, num_truth)
    reached = np.searchsorted(curve.recall, COCO_RECALLS, side="left")
    return float(np.append(_envelope(curve.precision), 0.0)[reached].mean())


def _envelope(precision: Array) -> Array:
    """Return (p,) the best precision at the same or any higher recall."""
    return np.maximum.accumulate(precision[::-1])[::-1]
