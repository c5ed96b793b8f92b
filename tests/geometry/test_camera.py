"""The pinhole camera."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.errors import ValueRangeError
from pipelines.geometry.camera import Intrinsics

CAMERA = Intrinsics(60.0, 62.0, 31.0, 23.5, 64, 48)


def test_projection_undoes_backprojection():
    depth = np.random.default_rng(0).uniform(0.3, 2.0, (48, 64))
    pixels = CAMERA.project(CAMERA.backproject(depth))
    assert_allclose(pixels[5, 7], [7, 5], atol=1e-9)
    assert_allclose(pixels[47, 63], [63, 47], atol=1e-9)


def test_missing_depth_is_nan():
    depth = np.ones((48, 64))
    depth[3, 4] = 0.0
    points = CAMERA.backproject(depth)
    assert np.isnan(points[3, 4]).all()
    assert np.isfinite(points).sum() == 3 * (48 * 64 - 1)


def test_a_resized_camera_sees_the_same_point_at_the_scaled_pixel():
    half = CAMERA.resized(32, 24)
    u, v = CAMERA.project([0.1, -0.05, 0.8])
    assert_allclose(half.project([0.1, -0.05, 0.8]), [(u + 0.5) / 2 - 0.5, (v + 0.5) / 2 - 0.5])


def test_the_matrix_round_trips():
    assert Intrinsics.from_matrix(CAMERA.matrix, 64, 48) == CAMERA


@pytest.mark.parametrize("fx", [0.0, -1.0, np.nan])
def test_impossible_focal_lengths_are_refused(fx):
    with pytest.raises(ValueRangeError, match="intrinsics"):
        Intrinsics(fx, 60.0, 31.0, 23.5, 64, 48)


def test_depth_of_another_size_is_refused():
    with pytest.raises(ValueRangeError, match="depth size"):
        CAMERA.backproject(np.ones((10, 10)))


def test_points_fall_on_pixels_of_the_image_or_not_into_it():
    camera = Intrinsics(100.0, 100.0, 2.0, 1.0, 5, 3)
    points = np.array([[0, 0, 1.0], [0.024, 0.006, 1], [-0.026, 0, 1], [0, 0.02, 1], [0, 0, -1]])
    pixels, inside = camera.pixels_of(points)
    assert inside.tolist() == [True, True, False, False, False]
    assert pixels[:4].tolist() == [[2, 1], [4, 2], [-1, 1], [2, 3]]


@given(st.integers(0, 2**31), st.integers(0, 60))
@settings(max_examples=25, deadline=None)
def test_pixels_are_those_that_points_project_to(seed, count):
    camera = Intrinsics(50.0, 60.0, 31.0, 23.5, 64, 48)
    points = np.random.default_rng(seed).normal(size=(count, 3))
    pixels, inside = camera.pixels_of(points)
    before = points[:, 2] > 0
    expected = np.full((count, 2), -1.0)
    expected[before] = np.round(camera.project(points[before]))
    np.testing.assert_array_equal(pixels, expected)
    np.testing.assert_array_equal(inside, ((expected >= 0) & (expected < [64, 48])).all(axis=1))
