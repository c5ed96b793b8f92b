"""Evenly strided rows of arrays: their number and their places."""

import numpy as np
import pytest

from pipelines.geometry.numerics.strides import strided_at_least, strided_at_most


@pytest.mark.parametrize("length", [0, 1, 6, 7, 8, 13, 14, 15, 100])
def test_strided_rows_are_evenly_spread_and_within_their_bounds(length):
    rows = np.arange(length)
    many, few = strided_at_least(rows, 7), strided_at_most(rows, 7)
    assert min(7, length) <= len(many) <= 14
    assert len(few) <= 7
    for some in (many, few):
        assert len(set(np.diff(some).tolist())) <= 1
        np.testing.assert_array_equal(some[:1], rows[:1])


def test_all_of_few_rows_are_taken():
    rows = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_array_equal(strided_at_least(rows, 5), rows)
    np.testing.assert_array_equal(strided_at_most(rows, 5), rows)
