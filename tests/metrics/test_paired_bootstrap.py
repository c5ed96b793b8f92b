"""Paired bootstrap: figures of drawn frames by weights, and intervals of differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.metrics.average_precision import average_precision
from pipelines.metrics.coco_masks import coco_average_precision
from pipelines.metrics.paired_bootstrap import (
    FrameMeans,
    FramePrecision,
    differences,
    draws,
    interval,
)

few = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32 - 1)


def predictions(rng: np.random.Generator, frames: int = 6, count: int = 40):
    confidence = rng.random(count)
    return confidence, rng.random(count) < 0.6, rng.integers(0, frames, count)


def copies(weights, confidence, correct, frame, num_truth):
    """The predictions of every frame as often as its weight, and the number of truths."""
    times = weights[frame].astype(int)
    return np.repeat(confidence, times), np.repeat(correct, times), int(weights @ num_truth)


@pytest.mark.parametrize("decimals", [9, 1, 0])
@given(seed=seeds)
@few
def test_weights_equal_copies_of_frames(seed, decimals):
    rng = np.random.default_rng(seed)
    confidence, correct, frame = predictions(rng)
    confidence = confidence.round(decimals)
    num_truth = rng.integers(6, 12, 6).astype(float)
    weights = next(iter(draws(6, 4, rng)))
    found = FramePrecision.ranked(confidence, correct, frame, num_truth).at(weights)
    coco = FramePrecision.ranked(confidence, correct, frame, num_truth, coco=True).at(weights)
    for row, area, mean in zip(weights, found, coco, strict=True):
        copied = copies(row, confidence, correct, frame, num_truth)
        assert area == pytest.approx(average_precision(*copied), abs=1e-9)
        assert mean == pytest.approx(coco_average_precision(*copied)[0], abs=1e-9)


@given(seeds)
@few
def test_the_mean_over_objects_equals_that_of_copies(seed):
    rng = np.random.default_rng(seed)
    values, frame = rng.random(20), rng.integers(0, 5, 20)
    sums = np.bincount(frame, values, minlength=5)
    figure = FrameMeans(sums, np.bincount(frame, minlength=5).astype(float))
    weights = next(iter(draws(5, 3, rng)))
    for row, mean in zip(weights, figure.at(weights), strict=True):
        if row[frame].any():
            assert mean == pytest.approx(np.average(values, weights=row[frame]))


def test_a_draw_holds_as_many_frames_as_there_are():
    blocks = list(draws(7, 10, np.random.default_rng(0)))
    assert np.concatenate(blocks).shape == (10, 7)
    assert (np.concatenate(blocks).sum(axis=1) == 7).all()


def test_difficulty_that_all_runs_share_cancels():
    rng = np.random.default_rng(0)
    hard, ones = rng.random(200), np.ones(200)
    first, second = FrameMeans(hard, ones), FrameMeans(hard + 0.01, ones)
    values, (difference,) = differences([first, second], np.arange(200), 500, 0.95, seed=0)
    assert values[0] == pytest.approx(hard.mean())
    assert difference.value == pytest.approx(0.01)
    assert (difference.low, difference.high) == pytest.approx((0.01, 0.01))
    assert difference.is_certain


def test_the_interval_has_the_width_of_theory():
    rng = np.random.default_rng(1)
    noise, ones = rng.normal(0.0, 0.2, 400), np.ones(400)
    zero = FrameMeans(np.zeros(400), ones)
    _, (difference,) = differences(
        [zero, FrameMeans(noise, ones)], np.arange(400), 4000, 0.95, seed=0
    )
    assert difference.high - difference.low == pytest.approx(2 * 1.96 * 0.2 / 20, rel=0.1)


def test_chance_is_rarely_taken_for_a_difference():
    rng = np.random.default_rng(3)
    zero, ones = np.zeros(60), np.ones(60)
    pairs = [[FrameMeans(zero, ones), FrameMeans(rng.normal(size=60), ones)] for _ in range(300)]
    certain = [
        differences(pair, np.arange(60), 300, 0.95, seed=0)[1][0].is_certain for pair in pairs
    ]
    assert 0.02 < np.mean(certain) < 0.10


@pytest.mark.parametrize("units", [2, 3, 4, 6, 8, 12, 20])
def test_few_units_seldom_give_a_false_difference(units):
    rng = np.random.default_rng(5)
    zero, ones, group = np.zeros(units), np.ones(units), np.arange(units)
    pairs = [[FrameMeans(zero, ones), FrameMeans(rng.normal(size=units), ones)] for _ in range(400)]
    found = [differences(pair, group, 400, 0.95, seed=0)[1][0] for pair in pairs]
    assert np.mean([difference.is_certain for difference in found]) < 0.10
    if units >= 6:
        assert np.mean([difference.low <= 0.0 <= difference.high for difference in found]) > 0.90


@pytest.mark.parametrize(("units", "certain"), [(5, False), (6, True)])
def test_six_units_that_all_differ_alike_are_a_certain_difference(units, certain):
    ones = np.ones(units)
    pair = [FrameMeans(np.zeros(units), ones), FrameMeans(np.linspace(0.5, 0.6, units), ones)]
    _, (difference,) = differences(pair, np.arange(units), 200, 0.95, seed=0)
    assert difference.low > 0.0
    assert difference.is_certain is certain


def test_draws_without_any_truth_are_left_out_of_an_interval():
    # Half of eight frames have objects: one draw in 2 ** 8 has none, and its mean is undefined.
    counts = np.array([1.0, 0.0] * 4)
    low, high = interval(
        FrameMeans(np.arange(8.0) * counts, counts), np.arange(8), 1000, 0.95, seed=0
    )
    assert 0.0 <= low < 3.0 < high <= 6.0


def test_one_unit_has_no_interval():
    ones = np.ones(4)
    pair = [FrameMeans(np.zeros(4), ones), FrameMeans(np.full(4, 0.3), ones)]
    _, (difference,) = differences(pair, np.zeros(4, np.int64), 100, 0.95, seed=0)
    assert difference.value == pytest.approx(0.3)
    assert np.isnan([difference.low, difference.high]).all()
    assert not difference.is_certain


def test_drawing_whole_scenes_of_similar_frames_widens_the_interval():
    rng = np.random.default_rng(4)
    scene, ones = np.repeat(np.arange(20), 10), np.ones(200)
    alike = FrameMeans(rng.normal(0.0, 0.2, 20)[scene], ones)
    pair = [FrameMeans(np.zeros(200), ones), alike]
    _, (frames,) = differences(pair, np.arange(200), 2000, 0.95, seed=0)
    _, (scenes,) = differences(pair, scene, 2000, 0.95, seed=0)
    assert frames.value == scenes.value
    width = (scenes.high - scenes.low) / (frames.high - frames.low)
    assert width == pytest.approx(np.sqrt(10), rel=0.15)


def test_the_same_seed_draws_the_same():
    rng = np.random.default_rng(2)
    figures = [FrameMeans(rng.random(30), np.ones(30)) for _ in range(3)]
    assert differences(figures, np.arange(30), 50, 0.9, seed=5) == differences(
        figures, np.arange(30), 50, 0.9, seed=5
    )
    assert differences(figures, np.arange(30), 50, 0.9, seed=5) != differences(
        figures, np.arange(30), 50, 0.9, seed=6
    )


def test_a_run_differs_from_itself_by_nothing():
    figure = FrameMeans(np.arange(10.0), np.ones(10))
    _, (difference,) = differences([figure, figure], np.arange(10), 50, 0.95, seed=0)
    assert (difference.value, difference.low, difference.high) == (0.0, 0.0, 0.0)
    assert not difference.is_certain


def test_figures_without_truth_are_nan():
    none = FramePrecision.ranked(np.zeros(0), np.zeros(0, bool), np.zeros(0, int), np.zeros(3))
    values, (difference,) = differences([none, none], np.arange(3), 20, 0.95, seed=0)
    assert np.isnan(values).all()
    assert np.isnan([difference.value, difference.low, difference.high]).all()
