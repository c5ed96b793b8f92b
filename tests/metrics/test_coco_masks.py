"""Mask AP computed image by image, against pycocotools on all images at once."""

import contextlib
import io

import numpy as np
import pytest

from pipelines.metrics.coco_masks import IOU_THRESHOLDS, coco_average_precision, match_masks


def disc(center: tuple[float, float], radius: float, shape: tuple[int, int] = (60, 80)):
    v, u = np.indices(shape)
    return (u - center[0]) ** 2 + (v - center[1]) ** 2 <= radius**2


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
        frames.append((truth, moved, rng.random(len(moved)).round(1)))  # some are equal
    return frames


def coco_summary(frames) -> list[float]:
    """AP, AP50 and AP75 of pycocotools for a dataset in memory."""
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
    return [float(value) for value in judge.stats[:3]]


def streamed(frames) -> np.ndarray:
    correct = np.hstack([match_masks(moved, values, truth) for truth, moved, values in frames])
    confidence = np.concatenate([values for _, _, values in frames])
    return coco_average_precision(confidence, correct, sum(len(truth) for truth, _, _ in frames))


@pytest.mark.parametrize("seed", range(4))
def test_frames_one_by_one_give_the_figures_of_pycocotools_for_all(seed):
    frames = random_frames(np.random.default_rng(seed))
    found = streamed(frames)
    expected = coco_summary(frames)
    assert [found.mean(), found[0], found[5]] == pytest.approx(expected, abs=1e-9)


def test_true_masks_as_predictions_are_right_at_every_threshold():
    masks = [disc((20, 20), 8), disc((50, 30), 10)]
    assert match_masks(masks, [0.2, 0.9], masks).all()
    assert coco_average_precision([0.2, 0.9], np.ones((10, 2)), 2) == pytest.approx(np.ones(10))


def test_the_more_confident_of_two_predictions_takes_the_truth():
    mask = disc((20, 20), 8)
    assert match_masks([mask, mask], [0.4, 0.6], [mask])[0].tolist() == [False, True]


def test_ap_is_zero_without_predictions_and_undefined_without_truth():
    mask = disc((20, 20), 8)
    assert match_masks([], [], [mask]).shape == (len(IOU_THRESHOLDS), 0)
    assert not match_masks([mask], [0.5], []).any()
    assert coco_average_precision([], np.zeros((10, 0)), 3).tolist() == [0.0] * 10
    assert np.isnan(coco_average_precision([0.5], np.zeros((10, 1)), 0)).all()
