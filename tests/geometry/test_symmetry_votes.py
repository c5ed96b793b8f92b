"""The votes of points, combined into one set of symmetry slots."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.symmetry_votes import mean_slots
from pipelines.geometry.transforms import (
    make_pose,
    random_rotation,
    rotate_vectors,
    transform_points,
    unit,
)

seeds = st.integers(0, 2**31)


def noisy_predictions(rng, count=200):
    normals = unit(rng.normal(size=(5, 3)))
    direction = unit(normals + 0.02 * rng.normal(size=(count, 5, 3)))
    direction *= rng.choice([-1.0, 1.0], (count, 5, 1))
    point = rng.normal(size=(5, 3)) + 0.001 * rng.normal(size=(count, 5, 3))
    existence = np.clip(rng.uniform(size=5) + 0.05 * rng.normal(size=(count, 5)), 0, 1)
    return normals, existence, point, direction


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_moving_the_predictions_moves_the_average(seed):
    rng = np.random.default_rng(seed)
    _, existence, point, direction = noisy_predictions(rng)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    here = mean_slots(existence, point, direction)
    there = mean_slots(existence, transform_points(T, point), rotate_vectors(T, direction))
    cosine = np.einsum("ki,ki->k", rotate_vectors(T, here.direction[:4]), there.direction[:4])
    np.testing.assert_allclose(np.abs(cosine), 1.0, atol=1e-9)
    np.testing.assert_allclose(transform_points(T, here.point), there.point, atol=1e-9)
    np.testing.assert_allclose(here.probability, there.probability)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_the_average_does_not_depend_on_the_signs_of_the_normals(seed):
    rng = np.random.default_rng(seed)
    normals, existence, point, direction = noisy_predictions(rng)
    slots = mean_slots(existence, point, direction)
    np.testing.assert_allclose(slots.probability, existence.mean(axis=0))
    np.testing.assert_allclose(slots.point, point.mean(axis=0))
    cosine = np.abs(np.einsum("ki,ki->k", slots.direction[:4], normals[:4]))
    assert (cosine > np.cos(0.02)).all()
