"""Holes between measured pixels are filled only where there are many."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.tabletop.sparse_depth import DENSE, HOLE_WINDOW, filled, measured_share
from tests.geometry.tabletops import Box, render

DEPTH = render([Box((0.06, 0.06, 0.1))])[0].astype(np.float32)


@pytest.mark.parametrize("lost", [0.0, 0.1, 0.25])
def test_dense_depth_is_not_changed(lost):
    depth = np.where(np.random.default_rng(0).random(DEPTH.shape) < lost, 0, DEPTH)
    assert measured_share(depth) >= DENSE
    assert filled(depth) is depth
    nothing = np.zeros((4, 5), np.float32)
    assert filled(nothing) is nothing


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), lost=st.floats(0.4, 0.8))
def test_a_hole_takes_the_depth_of_the_nearest_pixel_and_measured_pixels_do_not_change(seed, lost):
    rng = np.random.default_rng(seed)
    some = DEPTH[80:140, 120:200]
    depth = np.where(rng.random(some.shape) < lost, np.float32(0), some)
    result = filled(depth)
    measured = depth > 0
    np.testing.assert_array_equal(result[measured], depth[measured])
    places = np.argwhere(measured)
    for row, column in np.argwhere((result > 0) & ~measured)[::17]:
        gaps = np.hypot(*(places - [row, column]).T)
        nearest = depth[tuple(places[gaps <= gaps.min() * 1.05 + 1e-6].T)]
        assert result[row, column] in nearest
        assert gaps.min() < HOLE_WINDOW


def test_a_shadow_is_not_filled():
    depth = DEPTH.copy()
    depth[::2] = 0.0
    depth[60:120, 100:160] = 0.0
    result = filled(depth)
    assert not result[64:116, 104:156].any()
    assert result[1:50:2].any()
