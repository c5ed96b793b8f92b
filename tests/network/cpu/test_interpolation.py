"""Weighted sums of rows, compiled, and their gradients."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from pipelines.network.cpu.interpolation import add_interpolated, fast_weighted_sum


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


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
    assert torch.autograd.gradcheck(
        lambda given: fast_weighted_sum(given, places, weights), (values,)
    )
