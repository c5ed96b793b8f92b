"""Weighted sums of rows, compiled."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.network.cpu.folding import add_interpolated


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


@pytest.mark.parametrize("count", [0, 1, 50])
def test_sums_are_weighted_added_and_rectified(count):
    coarse, fine, rng = drawn(20, 7), drawn(count, 7, seed=1), np.random.default_rng(2)
    places, weights = rng.integers(0, 20, (count, 3)), drawn(count, 3, seed=3)
    expected = fine + (coarse[places] * weights[..., None]).sum(1)
    add_interpolated(coarse, places, weights, fine)
    expected = np.maximum(expected, 0.0)
    assert_allclose(fine, expected, rtol=1e-5, atol=1e-6)
