"""Precision, recall and average precision from predictions with confidences.

Predictions are matched to the truth one to one, the most confident first; a second prediction of
the same truth is wrong. Average precision is the whole area under the precision-recall curve, all
points. Predictions of equal confidence are one point: a threshold keeps all or none of them, so
their order means nothing. COCO's average precision of masks is in `coco_masks`.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Array


def match_greedy(confidence: ArrayLike, misfit: ArrayLike) -> NDArray[np.int64]:
    """Return (p,) the truth that each prediction takes, -1 for none.

    `confidence`: (p,) of the predictions; equal confidences keep the given order. `misfit`: (p, t),
    lower is better, inf where the pair is no match.
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
) -> tuple[Array, Array]:
    """Return recall (c,), rising, and precision (c,), one point per distinct confidence.

    `confidence`: (p,) of the predictions. `correct`: (p,) whether each is right. The recall is nan
    without any truth.
    """
    falling = np.asarray(confidence, np.float64)
    order = np.argsort(-falling, kind="stable")
    hits = np.cumsum(np.asarray(correct, np.bool_)[order])
    recall = hits / num_truth if num_truth else np.full(len(hits), np.nan)
    precision = hits / np.arange(1, len(hits) + 1)
    last = np.unique(last_equals(falling[order]))
    return recall[last], precision[last]


def last_equals(falling: Array) -> NDArray[np.int64]:
    """Return (p,) the place of the last confidence equal to each of `falling` (p,)."""
    differs = np.append(falling[1:] != falling[:-1], True)[: len(falling)]
    ends = np.flatnonzero(differs)
    return np.asarray(ends[np.cumsum(differs) - differs], np.int64)


def average_precision(confidence: ArrayLike, correct: ArrayLike, num_truth: int) -> float:
    """Return the area under the precision-recall curve, all points; nan without any truth.

    `confidence`, `correct`: (p,) of the predictions, in any order.
    """
    if num_truth == 0:
        return float("nan")
    recall, precision = precision_recall(confidence, correct, num_truth)
    return float(np.diff(recall, prepend=0.0) @ _envelope(precision))


def interpolated_precision(
    confidence: ArrayLike, correct: ArrayLike, num_truth: int, recalls: ArrayLike
) -> Array:
    """Return (r,) the best precision at each of `recalls` or beyond; 0 for recalls not reached.

    Other arguments as in `average_precision`.
    """
    recall, precision = precision_recall(confidence, correct, num_truth)
    reached = np.searchsorted(recall, np.asarray(recalls, np.float64), side="left")
    return np.append(_envelope(precision), 0.0)[reached]


def _envelope(precision: Array) -> Array:
    """Return (c,) the best precision at the same or any higher recall."""
    return np.maximum.accumulate(precision[::-1])[::-1]
