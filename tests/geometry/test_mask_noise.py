"""Disturbed masks: near the true ones, never empty, drawn from the generator alone."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.geometry.mask_noise import MaskNoise

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


def test_without_a_share_to_disturb_masks_stay_as_they_are():
    still = MaskNoise(share=0.0, edge=0.05, blot=0.15)
    assert_array_equal(still.applied(disc(), np.random.default_rng(0)), disc())


def test_an_empty_mask_stays_empty():
    empty = np.zeros((20, 30), dtype=bool)
    assert not NOISE.applied(empty, np.random.default_rng(0)).any()
