"""Average precision of masks, by COCO's own protocol and code."""

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask
from pipelines.metrics.coco_masks import coco_average_precision, match_masks


class MaskFigures:
    """Collects true and predicted masks frame by frame; `figures` sums them up."""

    def __init__(self) -> None:
        self._num_truth = 0
        self._confidence: list[NDArray[np.floating]] = []
        self._right: list[Mask] = []

    def add(self, truth: Mask, predicted: Mask, confidence: NDArray[np.floating]) -> None:
        """Take in one frame: masks (n, h, w) and (m, h, w), confidences (m,)."""
        self._num_truth += len(truth)
        self._confidence.append(confidence)
        self._right.append(match_masks(list(predicted), confidence.tolist(), list(truth)))

    def figures(self) -> dict[str, float]:
        """Return AP at IoU 0.5, AP averaged over IoU 0.5 to 0.95, and recall at IoU 0.5."""
        if not self._num_truth or not sum(map(len, self._confidence)):
            return {"mask_ap50": 0.0, "mask_ap": 0.0, "mask_recall50": 0.0}
        right = np.concatenate(self._right, axis=1)
        found = coco_average_precision(np.concatenate(self._confidence), right, self._num_truth)
        return {
            "mask_ap50": float(found[0]),
            "mask_ap": float(found.mean()),
            "mask_recall50": float(right[0].sum() / self._num_truth),
        }
