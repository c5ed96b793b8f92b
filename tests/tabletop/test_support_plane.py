"""Hypotheses of a plane in inverse depth, against numpy arrays."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.tabletop.support_plane import _counts, _moments


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
