"""Average precision of masks."""

import numpy as np
import pytest

from pipelines.learning.detector.mask_figures import MaskFigures


def square(x, size=10):
    mask = np.zeros((40, 60), bool)
    mask[10 : 10 + size, x : x + size] = True
    return mask


def test_masks_that_agree_give_an_average_precision_of_one():
    figures, masks = MaskFigures(), np.stack([square(5), square(30)])
    figures.add(masks, masks, np.array([0.9, 0.8]))
    assert figures.figures()["mask_ap50"] == pytest.approx(1.0)


def test_a_missed_region_halves_recall_and_a_confident_false_one_costs_precision():
    figures = MaskFigures()
    truth = np.stack([square(5), square(30)])
    figures.add(truth, np.stack([square(45), square(5)]), np.array([0.9, 0.8]))
    got = figures.figures()
    assert got["mask_recall50"] == pytest.approx(0.5)
    assert got["mask_ap50"] == pytest.approx(0.25, abs=0.01)


def test_without_predictions_all_is_zero():
    figures = MaskFigures()
    figures.add(np.stack([square(5)]), np.zeros((0, 40, 60), bool), np.zeros(0))
    assert figures.figures()["mask_ap50"] == 0.0
