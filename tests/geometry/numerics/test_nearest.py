"""Nearest neighbours by comparison with all points, against a tree."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from pipelines.geometry.numerics.nearest import Neighbors


@given(st.integers(1, 300), st.integers(0, 5), st.floats(0.005, 0.3), st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_neighbours_equal_those_of_a_tree(count, planes, size, seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * size + [0.1, -0.2, 1.5]
    queries = rng.normal(size=(planes, 100, 3)) * size + [0.1, -0.2, 1.5]
    away, nearest = Neighbors.of(points).nearest(queries)
    expected, _ = KDTree(points).query(queries)
    assert nearest.shape == away.shape == (planes, 100)
    np.testing.assert_allclose(away, expected, atol=2e-6)
    np.testing.assert_allclose(np.linalg.norm(queries - points[nearest], axis=-1), away)


def test_points_themselves_are_found():
    points = np.random.default_rng(0).normal(size=(50, 3))
    away, nearest = Neighbors.of(points).nearest(np.repeat(points, 3, axis=0))
    np.testing.assert_allclose(away, 0.0, atol=1e-6)
    np.testing.assert_array_equal(nearest, np.repeat(np.arange(50), 3))


@pytest.mark.parametrize("count", [1, 15, 16, 17, 31, 32, 47, 500])
def test_each_index_is_found_and_the_first_of_equal_points(count):
    points = np.random.default_rng(0).normal(size=(count, 3))
    twice = np.concatenate([points, points])
    _, nearest = Neighbors.of(twice).nearest(points)
    np.testing.assert_array_equal(nearest, np.arange(count))
