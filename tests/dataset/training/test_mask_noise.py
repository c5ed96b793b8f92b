"""Disturbed masks: near the true ones, never empty, drawn from the generator alone."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.dataset.training.mask_noise import MaskFaults, MaskNoise, leaked, truncated

seeds = st.integers(0, 2**32 - 1)
NOISE = MaskNoise(share=1.0, edge=0.05, blot=0.15)


def disc(radius=30, center=(60, 80)):
    rows, columns = np.ogrid[:120, :160]
    return (rows - center[0]) ** 2 + (columns - center[1]) ** 2 < radius**2


@settings(max_examples=25, deadline=None)
@given(seeds, st.integers(1, 55), st.integers(0, 119), st.integers(0, 159))
def test_a_disturbed_mask_stays_near_the_true_one_and_is_not_empty(seed, radius, row, column):
    mask = disc(radius, (row, column))
    noisy = NOISE.applied(mask, np.random.default_rng(seed))
    assert noisy.shape == mask.shape
    assert noisy.any()
    reach = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)[noisy].max()
    assert reach <= np.sqrt(mask.sum()) * 0.25 + 2


def test_masks_differ_from_draw_to_draw_and_repeat_with_the_seed():
    draws = [NOISE.applied(disc(), np.random.default_rng(seed)) for seed in range(6)]
    assert len({draw.tobytes() for draw in draws}) > 3
    assert_array_equal(draws[0], NOISE.applied(disc(), np.random.default_rng(0)))


def test_masks_do_not_change_if_the_share_to_disturb_is_zero():
    still = MaskNoise(share=0.0, edge=0.05, blot=0.15)
    assert_array_equal(still.applied(disc(), np.random.default_rng(0)), disc())


def test_an_empty_mask_stays_empty():
    empty = np.zeros((20, 30), dtype=bool)
    assert not NOISE.applied(empty, np.random.default_rng(0)).any()


@settings(max_examples=25, deadline=None)
@given(seeds, st.floats(0.1, 1.0))
def test_a_leak_adds_only_a_part_of_the_neighbour(seed, reach):
    mask, other = disc(20, (60, 60)), disc(20, (60, 98))
    result = leaked(mask, other, reach, np.random.default_rng(seed))
    gained = result & ~mask
    assert gained.any()
    assert not (gained & ~other).any()
    assert not (mask & ~result).any()


def test_masks_that_touch_nothing_do_not_leak():
    mask, far = disc(20, (60, 40)), disc(20, (60, 120))
    assert_array_equal(leaked(mask, far, 1.0, np.random.default_rng(0)), mask)


@settings(max_examples=25, deadline=None)
@given(seeds, st.floats(0.1, 0.5))
def test_a_truncated_mask_loses_the_given_share_on_one_side_of_a_line(seed, share):
    mask = disc()
    left = truncated(mask, share, np.random.default_rng(seed))
    assert not (left & ~mask).any()
    assert abs(1.0 - left.sum() / mask.sum() - share) < 0.03
    lost, kept = (np.stack(np.nonzero(each), 1).mean(0) for each in (mask & ~left, left))
    side = (np.stack(np.nonzero(mask), 1) - kept) @ (lost - kept)
    was_lost = ~left[mask]
    # Along the direction from kept to lost pixels, the lost pixels are farther.
    assert side[was_lost].mean() > side[~was_lost].mean()


def test_faults_are_as_frequent_as_configured():
    mask, other = disc(20, (60, 60)), disc(20, (60, 98))
    faults = MaskFaults(leak=0.3, cut=0.2)
    results = [faults.applied(mask, other, np.random.default_rng(i)) for i in range(300)]
    grew = sum((each & ~mask).any() for each in results) / 300
    shrank = sum((mask & ~each).any() for each in results) / 300
    assert 0.2 < grew < 0.4
    assert 0.12 < shrank < 0.28
