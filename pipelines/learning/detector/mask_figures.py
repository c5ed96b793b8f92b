"""Average precision of masks, by COCO's own protocol and code."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask
from pipelines.metrics.coco_masks import coco_average_precision, match_masks


def mask_figures(frames: Iterable[tuple[Mask, Mask, NDArray[np.floating]]]) -> dict[str, float]:
    """Return AP at IoU 0.5, AP averaged over IoU 0.5 to 0.95, and recall at IoU 0.5.

    `frames`: of each the true masks (n, h, w), the found ones (m, h, w), and their confidence (m,).
    """
    num_truth, right = 0, list[Mask]()
    confidence: list[NDArray[np.floating]] = []
    for truth, found, sure in frames:
        num_truth += len(truth)
        confidence.append(sure)
        right.append(match_masks(list(found), sure.tolist(), list(truth)))
    if not num_truth or not sum(map(len, confidence)):
        return {"mask_ap50": 0.0, "mask_ap": 0.0, "mask_recall50": 0.0}
    hits = np.concatenate(right, axis=1)
    precision = coco_average_precision(np.concatenate(confidence), hits, num_truth)
    return {
        "mask_ap50": float(precision[0]),
        "mask_ap": float(precision.mean()),
        "mask_recall50": float(hits[0].sum() / num_truth),
    }
