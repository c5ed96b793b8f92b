"""Mask overlaps, and mask AP against pycocotools."""

import contextlib
import io

import numpy as np
import pytest

from pipelines.metrics.average_precision import coco_average_precision
from pipelines.metrics.mask_overlap import mask_iou, match_masks, owner_of


def disc(center: tuple[float, float], radius: float, shape: tuple[int, int] = (60, 80)):
    v, u = np.indices(shape)
    return (u - center[0]) ** 2 + (v - center[1]) ** 2 <= radius**2


def box_mask(left: int, right: int):
    mask = np.zeros((10, 20), bool)
    mask[:, left:right] = True
    return mask


def random_frames(rng: np.random.Generator):
    """Frames of true masks, and noisy predictions of most of them with confidences."""
    frames = []
    for _ in range(6):
        circles = [(rng.uniform(10, 70), rng.uniform(10, 50), rng.uniform(4, 14)) for _ in range(5)]
        truth = [disc((u, v), r) for u, v, r in circles]
        moved = [
            disc((u + rng.normal(0, 3), v + rng.normal(0, 3)), r * rng.uniform(0.8, 1.2))
            for u, v, r in circles
            for _ in range(rng.integers(0, 3))
        ]
        frames.append((truth, moved, rng.random(len(moved))))
    return frames


def coco_ap50(frames) -> float:
    from pycocotools import mask as rle
    from pycocotools.coco import COCO
    from pycocotools.cocoeval import COCOeval

    def encode(mask):
        return rle.encode(np.asfortranarray(mask.astype(np.uint8)))

    truth, predicted = [], []
    for image, (masks, moved, confidence) in enumerate(frames):
        for mask in masks:
            entry = {"image_id": image, "category_id": 1, "iscrowd": 0, "id": len(truth) + 1}
            truth.append(entry | {"segmentation": encode(mask), "area": int(mask.sum())})
        for mask, value in zip(moved, confidence, strict=True):
            entry = {"image_id": image, "category_id": 1, "score": float(value)}
            predicted.append(entry | {"segmentation": encode(mask)})
    coco = COCO()
    coco.dataset = {
        "images": [{"id": i, "height": 60, "width": 80} for i in range(len(frames))],
        "annotations": truth,
        "categories": [{"id": 1, "name": "region"}],
    }
    with contextlib.redirect_stdout(io.StringIO()):
        coco.createIndex()
        judge = COCOeval(coco, coco.loadRes(predicted), "segm")
        judge.evaluate()
        judge.accumulate()
        judge.summarize()
    return float(judge.stats[1])


def own_ap50(frames) -> float:
    correct, confidence = [], []
    for truth, moved, values in frames:
        correct += (match_masks(values, mask_iou(moved, truth), 0.5) >= 0).tolist()
        confidence += values.tolist()
    return coco_average_precision(confidence, correct, sum(len(truth) for truth, _, _ in frames))


@pytest.mark.parametrize("seed", range(4))
def test_mask_ap50_equals_pycocotools(seed):
    frames = random_frames(np.random.default_rng(seed))
    assert own_ap50(frames) == pytest.approx(coco_ap50(frames), abs=1e-9)


def test_iou_of_known_masks():
    overlaps = mask_iou([box_mask(0, 10), box_mask(0, 0)], [box_mask(5, 15), box_mask(0, 10)])
    assert overlaps == pytest.approx(np.array([[1 / 3, 1.0], [0.0, 0.0]]))


def test_iou_of_no_masks_is_empty():
    assert mask_iou([], [box_mask(0, 1)]).shape == (0, 1)


def test_the_true_masks_match_themselves():
    masks = [box_mask(0, 5), box_mask(5, 15), box_mask(15, 20)]
    assert match_masks([0.2, 0.9, 0.5], mask_iou(masks, masks), 0.5).tolist() == [0, 1, 2]


def test_the_owner_of_a_mask_is_the_object_it_covers_most():
    label = np.zeros((10, 20), np.uint8)
    label[:, :6], label[:, 6:16] = 3, 7
    assert owner_of(box_mask(0, 10), label, 0.3) == 3
    assert owner_of(box_mask(4, 16), label, 0.3) == 7


def test_a_mask_on_the_table_has_no_owner():
    label = np.zeros((10, 20), np.uint8)
    label[:, :2] = 3
    assert owner_of(box_mask(0, 20), label, 0.3) == 0
    assert owner_of(box_mask(10, 20), label, 0.3) == 0
    assert owner_of(box_mask(0, 0), label, 0.0) == 0
