"""Quantiles, against numpy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.geometry.numerics.quantiles import median, quantiles

numbers = st.floats(-1e6, 1e6)


@given(st.lists(numbers, min_size=1, max_size=60), st.lists(st.floats(0, 1), min_size=1))
def test_quantiles_equal_those_of_numpy(values, shares):
    expected = np.quantile(values, shares)
    np.testing.assert_allclose(quantiles(values, shares), expected, atol=1e-9)
    np.testing.assert_allclose(quantiles(values, shares[0]), expected[0], atol=1e-9)
    assert median(values) == pytest.approx(np.median(values), abs=1e-9)


def test_each_row_has_its_own():
    rows = np.random.default_rng(0).normal(size=(4, 3, 50))
    expected = np.moveaxis(np.quantile(rows, [0.1, 0.9], axis=-1), 0, -1)
    np.testing.assert_allclose(quantiles(rows, [0.1, 0.9]), expected)
    np.testing.assert_allclose(median(rows), np.median(rows, axis=-1))


def test_many_numbers_have_the_same_quantiles_as_if_they_were_sorted():
    values = np.random.default_rng(0).integers(0, 900, (3, 5001)).astype(float)
    values[0, :40] = np.nan  # sorted last, as by numpy's sort
    shares = [0.0, 0.1, 0.5, 0.9003, 0.98]
    place = np.array(shares) * 5000
    ordered, below = np.sort(values, axis=-1), np.floor(place).astype(int)
    low, high = ordered[:, below], ordered[:, np.ceil(place).astype(int)]
    np.testing.assert_array_equal(quantiles(values, shares), low + (place - below) * (high - low))
