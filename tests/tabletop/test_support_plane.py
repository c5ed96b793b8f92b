"""The support plane, and its hypotheses in inverse depth against numpy arrays."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import RegionConfig
from pipelines.tabletop.support_plane import _counts, _moments, find_support
from tests.geometry.tabletops import CAMERA


def pixels(seed, count):
    """Return columns, rows and inverse depths about a plane, and hypotheses near it."""
    rng = np.random.default_rng(seed)
    u, v = rng.integers(0, 640, count) * 1.0, rng.integers(0, 480, count) * 1.0
    disparity = 1e-4 * u + 1e-3 * v + 0.9 + rng.normal(0, 0.01, count)
    return u, v, disparity, rng.normal((1e-4, 1e-3, 0.9), (1e-5, 1e-5, 0.01), (7, 3))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 300))
def test_hypotheses_are_counted_by_the_pixels_near_them(seed, count):
    u, v, disparity, hypotheses = pixels(seed, count)
    sample = np.stack([u, v, disparity]).astype(np.float32)
    found = _counts(hypotheses.astype(np.float32), sample, 0.01)
    away = np.abs(hypotheses @ np.stack([u, v, np.ones(count)]) - disparity)
    assert (found >= (away < 0.01 - 1e-5).sum(axis=1)).all()  # single precision leaves some open
    assert (found <= (away < 0.01 + 1e-5).sum(axis=1)).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 300))
def test_normal_equations_sum_over_the_pixels_near_a_plane(seed, count):
    u, v, disparity, hypotheses = pixels(seed, count)
    squares, products = _moments(u, v, disparity, tuple(hypotheses[0].tolist()), 0.01)
    design = np.stack([u, v, np.ones(count)])
    inliers = np.abs(hypotheses[0] @ design - disparity) < 0.01
    rows = design[:, inliers]
    np.testing.assert_allclose(squares, rows @ rows.T, rtol=1e-12)
    np.testing.assert_allclose(products, rows @ disparity[inliers], rtol=1e-12)


def support_of(depth):
    """The normal and the distance of the support plane of `depth` (240, 320)."""
    xyz, near = CAMERA.backproject(depth), depth > 0
    found = find_support(xyz, near, CAMERA, RegionConfig(), np.random.default_rng(0))
    return found.plane.normal, found.plane.offset


def test_a_wall_larger_than_the_table_in_the_image_is_not_the_table():
    # Both meet in row 130 of 240, at a depth of 1 / 1.2 metres, and come nearer at the same rate.
    away = np.abs(np.arange(240.0) - 130.0)[:, None] + np.zeros(320)
    normal, _ = support_of(1.0 / (1.2 + 0.003 * away))
    assert normal[1] < -0.5  # toward the image's top; that of the wall is toward its bottom


def test_the_table_between_tiles_that_cover_more_of_the_image_is_the_table():
    # Tiles at 65 cm in 60 of each 100 columns, between them the table at 70 cm.
    depth = np.where(np.arange(320) % 100 < 60, 0.65, 0.7) + np.zeros((240, 1))
    normal, distance = support_of(depth)
    np.testing.assert_allclose(normal, [0.0, 0.0, -1.0], atol=1e-3)
    np.testing.assert_allclose(distance, 0.7, atol=1e-3)
