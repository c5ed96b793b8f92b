"""Average precision of masks, by COCO's own protocol and code."""

import contextlib
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

Masks = NDArray[np.bool_]
MAX_DETECTIONS = 100


class MaskFigures:
    """Collects true and predicted masks frame by frame; `figures` sums them up."""

    def __init__(self) -> None:
        self._images: list[dict[str, Any]] = []
        self._truths: list[dict[str, Any]] = []
        self._predictions: list[dict[str, Any]] = []

    def add(self, truth: Masks, predicted: Masks, confidence: NDArray[np.floating]) -> None:
        """Take in one frame: masks (n, h, w) and (m, h, w), confidences (m,)."""
        image = len(self._images) + 1
        height, width = truth.shape[1:]
        self._images.append({"id": image, "height": height, "width": width})
        for mask in truth:
            number = len(self._truths) + 1
            box = _encoded(mask) | {"id": number, "image_id": image, "iscrowd": 0}
            self._truths.append(box | {"area": int(mask.sum())})
        for mask, value in zip(predicted, confidence, strict=True):
            self._predictions.append(_encoded(mask) | {"image_id": image, "score": float(value)})

    def figures(self) -> dict[str, float]:
        """Return AP at IoU 0.5, AP averaged over IoU 0.5 to 0.95, and recall at IoU 0.5."""
        if not self._truths or not self._predictions:
            return {"mask_ap50": 0.0, "mask_ap": 0.0, "mask_recall50": 0.0}
        with contextlib.redirect_stdout(io.StringIO()):  # the library prints its tables
            truth = COCO()
            dataset: Any = {
                "info": {},
                "images": self._images,
                "annotations": self._truths,
                "categories": [{"id": 1, "name": "region"}],
            }
            truth.dataset = dataset
            truth.createIndex()
            judge = COCOeval(
                truth, truth.loadRes([dict(each) for each in self._predictions]), "segm"
            )
            judge.params.maxDets = [1, 10, MAX_DETECTIONS]
            judge.evaluate()
            judge.accumulate()
        precision, recall = judge.eval["precision"], judge.eval["recall"]
        return {
            "mask_ap50": float(precision[0, :, 0, 0, -1].mean()),
            "mask_ap": float(precision[:, :, 0, 0, -1].mean()),
            "mask_recall50": float(recall[0, 0, 0, -1]),
        }


def _encoded(mask: Masks) -> dict[str, Any]:
    return {
        "segmentation": coco_mask.encode(np.asfortranarray(mask.astype(np.uint8))),
        "category_id": 1,
    }
