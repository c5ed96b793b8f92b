"""The network's axes: level, forward from the camera, the same for every camera rotation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import random_rotation, unit
from pipelines.tabletop.levelling import level_axes, table_of_row, table_row

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS)
def test_axes_are_a_rotation_with_up_along_the_tables_normal(seed):
    rng = np.random.default_rng(seed)
    center, up = rng.normal(size=3), unit(rng.normal(size=3))
    axes = level_axes(center, Plane(up, 0.5))
    assert_allclose(axes @ axes.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(axes) > 0
    assert_allclose(axes[2], up, atol=1e-12)


@given(SEEDS)
def test_axes_turn_with_the_camera(seed):
    rng = np.random.default_rng(seed)
    center, up, turn = rng.normal(size=3), unit(rng.normal(size=3)), random_rotation(rng)
    if abs(unit(center) @ up) > 0.99:  # looking straight down, the image defines forward
        return
    assert_allclose(
        level_axes(turn @ center, Plane(turn @ up, 0.5)),
        level_axes(center, Plane(up, 0.5)) @ turn.T,
        atol=1e-6,
    )


def test_forward_is_away_from_the_camera():
    axes = level_axes([0.0, 0.0, 0.7], Plane(np.array([0.0, -0.6, -0.8]), 0.5))
    assert_allclose(axes @ [0.0, 0.0, 0.7], [0.0, 0.42, -0.56], atol=1e-12)
    assert_allclose(axes[0], [1.0, 0.0, 0.0], atol=1e-12)  # right is towards the right of the image


def test_straight_down_forward_is_up_in_the_image():
    axes = level_axes([0.0, 0.0, 1.0], Plane(np.array([0.0, 0.0, -1.0]), 1.0))
    assert_allclose(axes, [[1, 0, 0], [0, -1, 0], [0, 0, -1]], atol=1e-12)


def test_without_a_table_the_camera_is_taken_to_look_down_by_45_degrees():
    up = level_axes([0.0, 0.0, 1.0], None)[2]
    assert np.degrees(np.arccos(-up[2])) == pytest.approx(45.0)


def test_a_table_comes_back_from_its_row():
    plane = Plane(np.array([0.0, 0.6, 0.8]), 0.3)
    again = table_of_row(table_row(plane))
    assert again is not None
    assert_allclose([*again.normal, again.offset], [0.0, 0.6, 0.8, 0.3])
    assert table_of_row(table_row(None)) is None
