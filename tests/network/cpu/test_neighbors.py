"""Nearest and farthest points, compiled, against sorting all distances."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.network.cpu.neighbors import find_farthest, find_nearest, find_three_nearest


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def squares(queries, support):
    """Squared distances, summed in the order of the loops; another order rounds otherwise."""
    x, y, z = np.moveaxis(queries[:, None] - support[None], -1, 0)
    return x * x + y * y + z * z


def by_sorting(queries, support, count):
    return squares(queries, support).argsort(-1, kind="stable")[:, :count]


def nearest(queries, support, count):
    places = np.full((len(queries), count), -1)
    find_nearest(queries, support, places)
    return places


def three(queries, support):
    places = np.full((len(queries), 3), -1)
    squared = np.full(places.shape, np.nan, np.float32)
    find_three_nearest(queries, support, places, squared)
    return places, squared


SIZES = [(1, 3), (64, 9), (200, 150), (65, 500), (0, 5)]


@pytest.mark.parametrize(("queries", "support"), SIZES)
def test_the_three_nearest_equal_those_of_sorting(queries, support):
    queries, support = drawn(queries, 3), drawn(support, 3, seed=1)
    places, squared = three(queries, support)
    assert_array_equal(places, by_sorting(queries, support, 3))
    assert_array_equal(squared, np.take_along_axis(squares(queries, support), places, 1))


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
@pytest.mark.parametrize(("queries", "support"), SIZES)
def test_the_nearest_equal_those_of_sorting(queries, support, share):
    count = max(1, round(share * support))
    queries, support = drawn(queries, 3), drawn(support, 3, seed=1)
    assert_array_equal(nearest(queries, support, count), by_sorting(queries, support, count))


@pytest.mark.parametrize("spread", [1e-6, 1.0, 100.0])  # distance of the next query from the last
def test_neighbours_do_not_depend_on_the_previous_query(spread):
    queries = drawn(60, 3) * np.logspace(0, np.log10(spread), 60, dtype=np.float32)[:, None]
    support = np.concatenate([drawn(200, 3, seed=1), 1e-3 * drawn(100, 3, seed=2)])
    assert_array_equal(nearest(queries, support, 16), by_sorting(queries, support, 16))


@pytest.mark.parametrize("shift", [0.0, 1.0, 3.0, 1000.0])
def test_the_first_of_equally_near_points_are_taken_on_a_grid_and_among_repeated_points(shift):
    rng = np.random.default_rng(0)
    support = rng.integers(0, (3, 3, 9), (120, 3)).astype(np.float32)
    queries = rng.integers(-2, (5, 5, 11), (200, 3)).astype(np.float32) + np.float32(shift)
    assert_array_equal(three(queries, support)[0], by_sorting(queries, support, 3))
    assert_array_equal(nearest(queries, support, 16), by_sorting(queries, support, 16))


def test_the_first_of_identical_points_are_taken():
    same = np.ones((300, 3), np.float32)
    assert_array_equal(nearest(same, same, 16), np.tile(np.arange(16), (300, 1)))
    assert_array_equal(three(same, same)[0], np.tile([0, 1, 2], (300, 1)))


@pytest.mark.parametrize("scale", [1e-23, 1e-20, 1e18])
def test_no_neighbour_is_lost_where_squares_vanish_or_nearly_overflow(scale):
    support, queries = drawn(60, 3) * np.float32(scale), drawn(80, 3, seed=1) * np.float32(scale)
    assert_array_equal(three(queries, support)[0], by_sorting(queries, support, 3))
    assert_array_equal(nearest(queries, support, 7), by_sorting(queries, support, 7))


def test_queries_that_are_nan_give_no_index_outside_the_cloud():
    queries, support = drawn(4, 3), drawn(5, 3, seed=1)
    queries[[0, 2]] = np.nan
    places, squared = three(queries, support)
    chosen = np.full(3, -1)
    find_farthest(queries, chosen)
    for found in (places, chosen, nearest(queries, support, 4)):
        assert ((found >= 0) & (found < 5)).all()
    assert np.isfinite(squared[[1, 3]]).all()


def test_the_first_of_points_that_are_equally_far_is_the_farthest():
    cloud = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1], [0, 0, 0]], np.float32)
    chosen = np.full(5, -1)
    find_farthest(cloud, chosen)
    assert_array_equal(chosen, [0, 1, 2, 3, 0])
