"""Faults of real depth: lost where dark or bright, floating at edges, never made up in gaps."""

import numpy as np
import pytest

from pipelines.synthesis.scenes.depth_faults import with_faults

HEIGHT, WIDTH = 90, 640
LEFT = np.arange(WIDTH)[None] < WIDTH // 2 + np.zeros((HEIGHT, 1), int)
STEP = np.where(LEFT, 0.6, 0.9)  # two surfaces, an edge between them
GREY = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
ONE = np.zeros((HEIGHT, WIDTH), int)
SEEDS = range(40)


def worn(depth=STEP, color=GREY, surface=ONE):
    return [with_faults(depth, color, surface, np.random.default_rng(seed)) for seed in SEEDS]


def missing(color):
    return np.array([(depth == 0)[LEFT].mean() for depth in worn(color=color)])


@pytest.mark.parametrize("level", [10, 250])
def test_dark_and_glaring_surfaces_lose_more_than_grey_ones(level):
    color = np.where(LEFT[..., None], np.uint8(level), GREY)
    assert missing(color).mean() > missing(GREY).mean() + 0.05


def test_a_surface_may_lose_its_depth_while_another_keeps_it():
    shares = [
        [(each == 0)[side].mean() for side in (LEFT, ~LEFT)] for each in worn(surface=LEFT * 1)
    ]
    assert any(left > 0.2 and right < 0.01 for left, right in shares)
    assert any(left < 0.01 and right > 0.2 for left, right in shares)


def test_pixels_float_between_the_sides_of_an_edge_and_nowhere_else():
    floating = [(each > 0.63) & (each < 0.87) for each in worn()]
    assert 0.3 < np.mean([each.any() for each in floating]) < 0.95
    far = np.abs(np.arange(WIDTH) - WIDTH // 2) > 12
    assert not any(each[:, far].any() for each in floating)


def test_depth_stays_within_millimetres_off_edges_and_none_appears_in_large_gaps():
    gap = STEP.copy()
    gap[20:70, 60:200] = 0.0
    for before, after in zip([gap] * len(SEEDS), worn(depth=gap), strict=True):
        assert not after[30:60, 90:170].any()
        seen = (before > 0) & (after > 0) & LEFT
        assert np.median(np.abs(after - before)[seen]) < 0.003


def test_the_same_seed_has_the_same_faults():
    first, again = (with_faults(STEP, GREY, ONE, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
