"""Three nearest points and their weighted sum, compiled, against sorting all distances."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.network.interpolation import (
    TINY,
    add_interpolated,
    find_three_nearest,
    interpolated,
)


def found(queries, support):
    places = np.full((len(queries), 3), -1, np.int64)
    weights = np.full((len(queries), 3), np.nan, queries.dtype)
    find_three_nearest(queries, support, places, weights)
    return places, weights


def drawn(*shape, seed=0, dtype=np.float32):
    return np.random.default_rng(seed).normal(size=shape).astype(dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("queries", "support"), [(1, 3), (64, 9), (200, 150), (65, 500), (0, 5)])
def test_the_three_nearest_are_those_of_sorting(queries, support, dtype):
    queries, support = drawn(queries, 3, dtype=dtype), drawn(support, 3, seed=1, dtype=dtype)
    squared = np.square(queries[:, None] - support[None]).sum(-1)
    nearest = squared.argsort(-1, kind="stable")[:, :3]
    weights = 1.0 / (np.take_along_axis(squared, nearest, 1) + TINY)
    places, got = found(queries, support)
    assert_array_equal(places, nearest)
    assert_allclose(got, weights / weights.sum(1, keepdims=True), rtol=1e-5)


def test_of_points_equally_far_the_first_ones_are_taken():
    support = np.array([[2, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0]], np.float32)
    places, weights = found(np.zeros((1, 3), np.float32), support)
    assert_array_equal(places, [[1, 2, 3]])
    assert_allclose(weights, 1.0 / 3.0, rtol=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shift", [0.0, 1.0, 3.0, 1000.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_on_a_grid_and_among_repeated_points_the_first_ones_are_taken(axis, shift, dtype):
    rng = np.random.default_rng(axis)
    steps = np.array([3, 3, 3])
    steps[axis] = 9  # the axis along which points are put in order
    support = rng.integers(0, steps, (120, 3)).astype(dtype)
    queries = rng.integers(-2, steps + 2, (200, 3)).astype(dtype) + dtype(shift)
    squared = np.square(queries[:, None] - support[None]).sum(-1)
    places, _ = found(queries, support)
    assert_array_equal(places, squared.argsort(-1, kind="stable")[:, :3])


@pytest.mark.parametrize("scale", [1e-23, 1e-20, 1e18])
def test_where_squares_vanish_or_nearly_overflow_none_is_left_out(scale):
    support = (drawn(60, 3) * np.float32(scale)).astype(np.float32)
    queries = (drawn(80, 3, seed=1) * np.float32(scale)).astype(np.float32)
    a, b, c = np.moveaxis(queries[:, None] - support[None], -1, 0)
    squared = a * a + b * b + c * c
    places, _ = found(queries, support)
    assert_array_equal(places, squared.argsort(-1, kind="stable")[:, :3])


@pytest.mark.parametrize("size", [1, 2])
def test_points_that_are_not_there_weigh_nothing(size):
    places, weights = found(drawn(70, 3), drawn(size, 3, seed=1))
    assert_array_equal(weights[:, size:], 0.0)
    assert_allclose(weights.sum(1), 1.0, rtol=1e-6)
    assert ((places >= 0) & (places < size)).all()


def test_of_what_is_no_number_no_place_outside_the_cloud_is_named():
    queries = drawn(4, 3)
    queries[2] = np.nan
    places, weights = found(queries, drawn(5, 3, seed=1))
    assert_array_equal(places[2], 0)
    assert np.isfinite(weights[[0, 1, 3]]).all()


@pytest.mark.parametrize("count", [0, 1, 50])
@pytest.mark.parametrize("rectifies", [False, True])
def test_sums_are_weighted_added_and_rectified(count, rectifies):
    coarse, fine, rng = drawn(20, 7), drawn(count, 7, seed=1), np.random.default_rng(2)
    places, weights = rng.integers(0, 20, (count, 3)), drawn(count, 3, seed=3)
    expected = fine + (coarse[places] * weights[..., None]).sum(1)
    add_interpolated(rectifies, coarse, places, weights, fine)
    expected = np.maximum(expected, 0.0) if rectifies else expected
    assert_allclose(fine, expected, rtol=1e-5, atol=1e-6)


def test_gradients_of_what_is_interpolated_are_those_of_finite_differences():
    torch.manual_seed(0)
    values = torch.randn(2, 5, 3, dtype=torch.float64, requires_grad=True)
    places, weights = torch.randint(0, 5, (2, 9, 3)), torch.rand(2, 9, 3).double()
    assert torch.autograd.gradcheck(lambda given: interpolated(given, places, weights), (values,))
