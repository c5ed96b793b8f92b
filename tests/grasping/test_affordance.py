"""Affordance of surface points from contact pairs, against a plain loop."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.refinement.copies import NUM_LEVELS, point_affordance

seeds = st.integers(0, 2**32 - 1)


def naive(points, contacts, quality, radius):
    result = np.zeros(len(points))
    for i, point in enumerate(points):
        for pair, q in zip(contacts, quality, strict=True):
            if np.linalg.norm(pair - point, axis=1).min() < radius:
                result[i] = max(result[i], q)
    return result


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_affordance_is_the_best_quality_within_reach(seed):
    rng = np.random.default_rng(seed)
    points, contacts = rng.uniform(size=(40, 3)), rng.uniform(size=(25, 2, 3))
    quality = rng.integers(0, 10, 25) / 10.0
    expected = naive(points, contacts, quality, 0.25)
    assert_allclose(point_affordance(points, contacts, quality, 0.25), expected)


def test_many_different_qualities_are_rounded_down_by_less_than_a_level():
    rng = np.random.default_rng(0)
    points, contacts, quality = (
        rng.uniform(size=(60, 3)),
        rng.uniform(size=(200, 2, 3)),
        rng.uniform(size=200),
    )
    lost = naive(points, contacts, quality, 0.2) - point_affordance(points, contacts, quality, 0.2)
    assert lost.min() >= 0.0
    assert lost.max() < 1.0 / NUM_LEVELS


def test_points_without_a_contact_in_reach_get_zero():
    contacts = np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]])
    points = np.array([[0.05, 0.0, 0.0], [0.103, 0.0, 0.0]])
    assert_allclose(point_affordance(points, contacts, [0.8], 0.004), [0.0, 0.8])


def test_without_contact_pairs_there_is_no_affordance():
    assert_allclose(point_affordance(np.ones((3, 3)), np.zeros((0, 2, 3)), np.zeros(0), 1.0), 0.0)
