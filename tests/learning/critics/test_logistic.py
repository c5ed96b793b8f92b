"""Logistic regressions recover the odds behind their truth; the best of each group is found."""

import numpy as np
import pytest
from scipy.special import expit

from pipelines.learning.critics.logistic import (
    best_of_groups,
    log_loss,
    logistic_regression,
)

WEIGHTS = np.array([-3.0, 2.0, 0.0, 4.0])


def drawn(count, seed=0, weights=WEIGHTS):
    rng = np.random.default_rng(seed)
    columns = rng.random((count, len(weights) - 1))
    odds = weights[0] + columns @ weights[1:]
    return columns, (rng.random(count) < expit(odds)).astype(float)


def test_the_regression_recovers_the_weights_behind_the_truth():
    columns, truth = drawn(200_000)
    np.testing.assert_allclose(logistic_regression(columns, truth), WEIGHTS, atol=0.1)


def test_no_other_weights_have_a_smaller_loss():
    columns, truth = drawn(5000)
    found = logistic_regression(columns, truth)
    least = log_loss(found[0] + columns @ found[1:], truth)
    for change in 0.2 * np.eye(4):
        for weights in (found + change, found - change):
            assert log_loss(weights[0] + columns @ weights[1:], truth) > least


def test_an_uninformative_column_gets_weight_zero():
    columns, truth = drawn(500)
    columns[:, 1] = 7.0
    assert logistic_regression(columns, truth)[2] == pytest.approx(0.0, abs=1e-6)


def test_the_best_of_each_group_is_found_and_the_first_of_equal_ones():
    scores = np.array([0.1, 0.9, 0.9, 0.3, -1.0, -2.0])
    group = np.array([0, 0, 0, 5, 9, 9])
    assert best_of_groups(scores, group).tolist() == [1, 3, 4]
