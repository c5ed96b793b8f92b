"""Average precision of masks."""

import numpy as np
import pytest

from pipelines.learning.detector.detector_training import mask_figures


def square(x, size=10):
    mask = np.zeros((40, 60), bool)
    mask[10 : 10 + size, x : x + size] = True
    return mask


def test_equal_masks_give_an_average_precision_of_one():
    masks = np.stack([square(5), square(30)])
    assert mask_figures([(masks, masks, np.array([0.9, 0.8]))])["mask_ap50"] == pytest.approx(1.0)


def test_a_missed_region_halves_recall_and_a_confident_false_one_costs_precision():
    truth, found = np.stack([square(5), square(30)]), np.stack([square(45), square(5)])
    got = mask_figures([(truth, found, np.array([0.9, 0.8]))])
    assert got["mask_recall50"] == pytest.approx(0.5)
    assert got["mask_ap50"] == pytest.approx(0.25, abs=0.01)


def test_all_figures_are_zero_without_predictions():
    nothing = np.zeros((0, 40, 60), bool), np.zeros(0)
    assert mask_figures([(np.stack([square(5)]), *nothing)])["mask_ap50"] == 0.0
