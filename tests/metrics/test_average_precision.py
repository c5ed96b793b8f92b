"""Matching, precision-recall and both average precisions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.metrics.average_precision import (
    average_precision,
    interpolated_precision,
    match_greedy,
    precision_recall,
)

few = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32 - 1)


def test_the_most_confident_prediction_takes_the_truth():
    misfit = np.array([[0.1], [0.0]])
    assert match_greedy([0.9, 0.5], misfit).tolist() == [0, -1]
    assert match_greedy([0.5, 0.9], misfit).tolist() == [-1, 0]


def test_a_prediction_takes_its_closest_free_truth():
    misfit = np.array([[0.2, 0.1], [np.inf, 0.05]])
    assert match_greedy([0.9, 0.8], misfit).tolist() == [1, -1]


def test_no_truth_leaves_every_prediction_without_match():
    assert match_greedy([0.3, 0.4], np.zeros((2, 0))).tolist() == [-1, -1]
    assert match_greedy([], np.zeros((0, 2))).tolist() == []


def test_average_precision_of_a_known_ranking():
    # Right, wrong, right of three truths: 1/3 at precision 1, 1/3 at 2/3, the rest never found.
    value = average_precision([0.9, 0.8, 0.7], [True, False, True], 3)
    assert value == pytest.approx(1 / 3 + 2 / 9)


def test_perfect_predictions_have_average_precision_one():
    assert average_precision([0.4, 0.9], [True, True], 2) == 1.0


def test_average_precision_without_truth_is_undefined():
    assert np.isnan(average_precision([0.5], [False], 0))


def test_average_precision_without_predictions_is_zero():
    assert average_precision([], [], 4) == 0.0


def test_equal_confidences_give_one_point_of_the_curve():
    # Three of one confidence, two right: precision 2/3 up to recall 1/2, whichever comes first.
    for correct in ([True, True, False], [False, True, True]):
        assert average_precision([0.5] * 3, correct, 4) == pytest.approx(1 / 3)
        assert precision_recall([0.5] * 3, correct, 4)[0].tolist() == [0.5]


def test_the_precision_at_a_recall_that_is_just_reached_counts():
    # One of two truths is found first, the other never: precision 1 up to a recall of 1/2.
    found = interpolated_precision([0.9, 0.8], [True, False], 2, [0.0, 0.5, 0.51])
    assert found.tolist() == [1.0, 1.0, 0.0]


@given(seeds)
@few
def test_average_precision_does_not_depend_on_the_order(seed):
    rng = np.random.default_rng(seed)
    confidence, correct = rng.integers(0, 6, 30) / 6, rng.random(30) < 0.5
    value = average_precision(confidence, correct, 40)
    order = rng.permutation(30)
    assert average_precision(confidence[order], correct[order], 40) == value
    thresholds = np.unique(confidence)[::-1]
    points = [(correct[confidence >= t].sum() / 40, correct[confidence >= t].mean())
              for t in thresholds]  # fmt: skip
    area, recall = 0.0, 0.0
    for place, (reached, _) in enumerate(points):
        area += (reached - recall) * max(precision for _, precision in points[place:])
        recall = reached
    assert value == pytest.approx(area)


@given(seeds)
@few
def test_each_truth_is_taken_once(seed):
    rng = np.random.default_rng(seed)
    misfit = np.where(rng.random((12, 5)) < 0.4, rng.random((12, 5)), np.inf)
    taken = match_greedy(rng.random(12), misfit)
    used = taken[taken >= 0]
    assert len(used) == len(set(used.tolist()))


@given(seeds)
@few
def test_recall_rises_and_average_precision_is_bounded_by_it(seed):
    rng = np.random.default_rng(seed)
    confidence, correct = rng.random(30), rng.random(30) < 0.5
    recall, _ = precision_recall(confidence, correct, 40)
    assert (np.diff(recall) >= 0).all()
    assert 0.0 <= average_precision(confidence, correct, 40) <= recall[-1]


@given(seeds)
@few
def test_a_wrong_prediction_at_the_end_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    confidence, correct = rng.uniform(0.1, 1.0, 10), rng.random(10) < 0.5
    longer = average_precision([*confidence, 0.05], [*correct, False], 12)
    assert longer == pytest.approx(average_precision(confidence, correct, 12))


@given(seeds)
@few
def test_the_mean_of_interpolated_precision_approaches_the_area(seed):
    rng = np.random.default_rng(seed)
    confidence, correct = rng.random(30), rng.random(30) < 0.5
    recalls = (np.arange(20000) + 0.5) / 20000
    mean = interpolated_precision(confidence, correct, 40, recalls).mean()
    assert mean == pytest.approx(average_precision(confidence, correct, 40), abs=2e-3)
