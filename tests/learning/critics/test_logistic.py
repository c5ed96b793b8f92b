"""Logistic regressions recover the odds behind their truth; the best of each group is found."""

import numpy as np
import pytest
from scipy.special import expit

from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.learning.critics.critic_rows import CriticRows
from pipelines.learning.critics.logistic import (
    best_of_groups,
    fit_axis_critic,
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


def rows_of(columns, truth, slot):
    count = len(truth)
    empty = np.zeros((count, 0, 0)), np.zeros((count, 0))
    return CriticRows.of_group(*empty, columns, truth, np.full(count, slot))


def test_axes_are_fitted_to_the_axes_that_the_fit_prefers():
    rng, groups = np.random.default_rng(0), []
    for _ in range(400):
        columns = rng.random((3, 3))
        true = (rng.random(3) < expit(-6.0 + 8.0 * columns[:, 2])).astype(float)
        groups.append(rows_of(columns, true, ROTATION_SLOT))
    spheres = rows_of(*drawn(400), SPHERE_SLOT)
    critic = fit_axis_critic(CriticRows.joined([*groups, spheres]))
    axes = CriticRows.joined(groups)
    chosen = best_of_groups(critic.log_odds("rotation", axes.candidates), axes.group)
    assert len(chosen) == 400
    again = logistic_regression(axes.candidates[chosen].astype(float), axes.truth[chosen])
    np.testing.assert_allclose(critic.rotation, again, atol=0.05)
    columns = spheres.candidates.astype(float)
    np.testing.assert_allclose(critic.sphere, logistic_regression(columns, spheres.truth))


@pytest.mark.parametrize("truth", [0.0, 1.0])
def test_axes_or_spheres_of_equal_truth_are_refused(truth):
    spheres = rows_of(*drawn(50), SPHERE_SLOT)
    axes = rows_of(np.random.default_rng(0).random((9, 3)), np.full(9, truth), ROTATION_SLOT)
    with pytest.raises(ValueRangeError, match=f"candidate axes is {int(9 * truth)} of 9 are true"):
        fit_axis_critic(CriticRows.joined([axes, spheres]))
    with pytest.raises(ValueRangeError, match="candidate spheres is 0 of 0 are true"):
        fit_axis_critic(rows_of(*drawn(50), ROTATION_SLOT))
