"""Rectangles as boxes with orientation classes, and back."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.grasping.peers.oriented_boxes import (
    horizontal_boxes,
    orientation_classes,
    rows_of_boxes,
    spread_rows,
)
from pipelines.grasping.peers.rectangles import angles, rectangle_hits, rectangle_rows


def some_rows(*degrees: float) -> np.ndarray:
    count = len(degrees)
    sizes = np.full(count, 40.0), np.full(count, 12.0)
    return rectangle_rows(np.full((count, 2), 100.0), np.radians(degrees), *sizes, np.ones(count))


@pytest.mark.parametrize(
    ("degrees", "expected"), [(-90.0, 1), (0.0, 10), (10.0, 11), (84.0, 18), (86.0, 1)]
)
def test_a_class_is_ten_degrees_and_the_last_class_equals_the_first(degrees, expected):
    assert orientation_classes(some_rows(degrees)).tolist() == [expected]


def test_the_box_is_the_rectangle_turned_back_to_horizontal():
    assert_allclose(horizontal_boxes(some_rows(70.0)), [[80.0, 94.0, 120.0, 106.0]])


@pytest.mark.parametrize("degrees", [-90.0, -37.0, 0.0, 44.0, 89.0])
def test_a_grasp_comes_back_within_half_a_class(degrees):
    rows = some_rows(degrees)
    back = rows_of_boxes(horizontal_boxes(rows), orientation_classes(rows), np.ones(1))
    assert_allclose(back[:, :2], rows[:, :2])
    assert_allclose(np.linalg.norm(back[:, 2:4] - back[:, :2], axis=1), 20.0)
    turn = np.degrees(angles(back) - angles(rows))
    assert abs((turn + 90.0) % 180.0 - 90.0) <= 5.0 + 1e-6
    assert rectangle_hits(back, rows).all()


def test_the_published_class_19_is_the_first():
    boxes = horizontal_boxes(some_rows(0.0))
    one, last = (rows_of_boxes(boxes, np.array([c]), np.ones(1)) for c in (1, 19))
    assert_allclose(angles(one), angles(last), atol=1e-9)


def test_rectangles_of_each_object_are_kept_far_from_each_other():
    rows = np.concatenate([some_rows(*[0.0] * 50), some_rows(90.0), some_rows(0.0)])
    rows[:50, 0] += np.linspace(0.0, 1.0, 50)
    rows[-1, 6] = 3
    kept = spread_rows(rows, 2)
    assert kept.tolist() == [0, 50, 51]


def test_a_hit_overlaps_and_has_the_same_direction():
    wanted = some_rows(0.0)
    near, turned, far = wanted.copy(), some_rows(40.0), wanted + 0.0
    near[:, [0, 2]] += 5.0
    far[:, [0, 2]] += 60.0
    found = np.concatenate([near, turned, far])
    assert rectangle_hits(found, wanted).tolist() == [True, False, False]
    assert rectangle_hits(found, wanted[:0]).tolist() == [False] * 3
