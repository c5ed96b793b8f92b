"""Mask overlaps, and the object that a mask belongs to."""

import numpy as np
import pytest

from pipelines.metrics.mask_overlap import mask_iou, owner_of


def box_mask(left: int, right: int):
    mask = np.zeros((10, 20), bool)
    mask[:, left:right] = True
    return mask


def test_iou_of_known_masks():
    overlaps = mask_iou([box_mask(0, 10), box_mask(0, 0)], [box_mask(5, 15), box_mask(0, 10)])
    assert overlaps == pytest.approx(np.array([[1 / 3, 1.0], [0.0, 0.0]]))


def test_iou_of_no_masks_is_empty():
    assert mask_iou([], [box_mask(0, 1)]).shape == (0, 1)


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
