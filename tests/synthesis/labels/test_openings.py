"""Openings of candidates whose lines cross known surfaces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.geometry.meshes.line_crossings import Crossings
from pipelines.synthesis.labels.openings import openings
from tests.synthesis import naive_labels


def side(*surfaces: tuple[float, float]) -> Crossings:
    distance, cosine = np.array(surfaces).reshape(-1, 2).T
    return Crossings(distance[None], cosine[None])


def halves(below: Crossings, above: Crossings) -> list[float]:
    half = openings(below, above, 0.005, 0.06).half[0]
    return sorted(set(half[np.isfinite(half)].tolist()))  # both sides may need the same opening


def test_a_solid_between_the_fingers_has_one_opening() -> None:
    found = openings(side((0.01, 0.8)), side((0.02, 0.6)), 0.005, 0.06)
    assert_allclose(found.half[0, 0], 0.025)
    assert_allclose(found.friction[0, 0], 0.8 / 0.6)
    assert not np.isfinite(found.half[0, 1:]).any()


def test_a_wall_and_the_far_wall_of_a_cup_have_two() -> None:
    far = ((0.0015, 1.0), (0.04, -1.0), (0.043, 1.0))
    assert_allclose(halves(side((0.0015, 1.0)), side(*far)), [0.0065, 0.048])


@pytest.mark.parametrize(("gap", "expected"), [(0.006, [0.015, 0.024]), (0.004, [0.023 - 0.001])])
def test_an_opening_spans_a_gap_without_a_free_line_behind_the_contact(
    gap: float, expected: list[float]
) -> None:
    beyond = ((0.01, 1.0), (0.01 + gap, -1.0), (0.013 + gap, 1.0))
    found = halves(side((0.01, 1.0)), side(*beyond))
    assert_allclose(found, expected)


def test_the_widest_opening_may_leave_less_behind_the_contact() -> None:
    assert_allclose(halves(side((0.058, 1.0)), side((0.02, 1.0))), [0.06])
    assert halves(side((0.061, 1.0)), side((0.02, 1.0))) == []


def test_a_finger_inside_the_object_has_no_contact() -> None:
    assert halves(side((0.01, -1.0)), side((0.01, 1.0))) == []


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=100, deadline=None)
def test_openings_equal_those_of_a_slow_check(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sides = []
    for _ in range(2):
        count = int(rng.integers(1, 7))
        distance = np.sort(rng.uniform(0.0, 0.07, count))
        # Signs alternate mostly, as on a closed surface, and sometimes do not.
        cosine = rng.uniform(0.2, 1.0, count) * np.where(np.arange(count) % 2, -1, 1)
        cosine *= rng.choice([-1, 1], count, p=[0.1, 0.9])
        sides.append((distance, cosine))
    below, above = sides
    hits = np.concatenate([-below[0], above[0]]), np.concatenate([-below[1], above[1]])
    expected = naive_labels.openings(hits)
    limited = [Crossings(d[None, d <= 0.06], c[None, d <= 0.06]) for d, c in sides]
    if not all(each.leave.any() for each in limited):
        assert expected == []
        return
    found = openings(*limited, naive_labels.MARGIN, naive_labels.WIDEST)
    there = np.isfinite(found.half[0])
    pairs = sorted(set(zip(found.half[0, there].tolist(), found.friction[0, there], strict=True)))
    assert_allclose(np.reshape(pairs, (-1, 2)), np.reshape(expected, (-1, 2)), rtol=1e-9)
