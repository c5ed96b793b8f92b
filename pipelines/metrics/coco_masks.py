"""Average precision of masks, computed by pycocotools.

`match_masks` is COCOeval's matching of one image; `coco_average_precision` is COCOeval's
accumulation of the matches of all images. So images need not be in memory together.
"""

import contextlib
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pycocotools import mask as run_lengths
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from pipelines.array_types import Array, Mask

IOU_THRESHOLDS = tuple(round(0.5 + 0.05 * step, 2) for step in range(10))
ANY_AREA = [0.0, 1e10]


def match_masks(masks: Sequence[Mask], confidence: Sequence[float], truth: Sequence[Mask]) -> Mask:
    """Return (10, p) whether each predicted mask is right, at each of IOU_THRESHOLDS.

    Each mask of `truth` is matched once, by the most confident prediction. All masks (H, W) are of
    one image and one class.
    """
    if not masks or not truth:
        return np.zeros((len(IOU_THRESHOLDS), len(masks)), np.bool_)
    known, found = _image(truth, [1.0] * len(truth)), _image(masks, confidence)
    with contextlib.redirect_stdout(io.StringIO()):  # pycocotools prints progress
        matching = COCOeval(known, found, "segm")
        matching.params.maxDets = [len(masks)]
        matching.params.areaRng = [ANY_AREA]
        matching.params.areaRngLbl = ["all"]
        matching.evaluate()
    entry = matching.evalImgs[0]
    right = np.zeros((len(IOU_THRESHOLDS), len(masks)), np.bool_)
    right[:, np.array(entry["dtIds"]) - 1] = np.asarray(entry["dtMatches"]) > 0
    return right


def coco_average_precision(confidence: ArrayLike, correct: ArrayLike, num_truth: int) -> Array:
    """Return (k,) COCO's average precision at each of k thresholds; nan without any truth.

    `confidence`: (p,) of the predictions of all images. `correct`: (k, p) whether each is right.
    """
    right = np.atleast_2d(np.asarray(correct, np.bool_))
    if num_truth == 0:
        return np.full(len(right), np.nan)
    scores = np.asarray(confidence, np.float64)
    with contextlib.redirect_stdout(io.StringIO()):
        curves: Any = COCOeval(iouType="segm")
        curves.params.imgIds, curves.params.catIds = [0], [1]
        curves.params.iouThrs = np.arange(len(right), dtype=np.float64)
        curves.params.maxDets = [max(len(scores), 1)]
        curves.params.areaRng, curves.params.areaRngLbl = [ANY_AREA], ["all"]
        curves._paramsEval = curves.params
        curves.evalImgs = [
            {
                "dtScores": scores.tolist(),
                "dtMatches": right.astype(np.float64),
                "dtIgnore": np.zeros(right.shape, np.bool_),
                "gtIgnore": np.zeros(num_truth, np.bool_),
            }
        ]
        curves.accumulate()
    return np.asarray(curves.eval["precision"][:, :, 0, 0, 0].mean(axis=1))


def _image(masks: Sequence[Mask], confidence: Sequence[float]) -> Any:  # noqa: ANN401 - a COCO object without a useful type
    """Return the masks of one image as a COCO data set; ids count from 1."""
    height, width = masks[0].shape
    entries: list[dict[str, Any]] = []
    for index, (mask, score) in enumerate(zip(masks, confidence, strict=True)):
        counts = run_lengths.encode(np.asfortranarray(mask.astype(np.uint8)))
        entry = {"id": index + 1, "image_id": 0, "category_id": 1, "iscrowd": 0}
        entries.append(
            entry | {"segmentation": counts, "area": int(mask.sum()), "score": float(score)}
        )
    coco: Any = COCO()
    coco.dataset = {
        "images": [{"id": 0, "height": height, "width": width}],
        "annotations": entries,
        "categories": [{"id": 1, "name": "region"}],
    }
    with contextlib.redirect_stdout(io.StringIO()):
        coco.createIndex()
    return coco
