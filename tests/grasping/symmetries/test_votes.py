"""The votes of points, put together as one set of symmetry slots."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.transforms import (
    make_pose,
    random_rotation,
    rotate_vectors,
    transform_points,
    unit,
)
from pipelines.grasping.symmetries.votes import mean_slots, voted_slots, weighted_medians

seeds = st.integers(0, 2**31)


def noisy_predictions(rng, count=200):
    normals = unit(rng.normal(size=(5, 3)))
    direction = unit(normals + 0.02 * rng.normal(size=(count, 5, 3)))
    direction *= rng.choice([-1.0, 1.0], (count, 5, 1))
    point = rng.normal(size=(5, 3)) + 0.001 * rng.normal(size=(count, 5, 3))
    existence = np.clip(rng.uniform(size=5) + 0.05 * rng.normal(size=(count, 5)), 0, 1)
    return normals, existence, point, direction, rng.uniform(size=count)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_opposite_normals_average_to_their_plane(seed):
    rng = np.random.default_rng(seed)
    normals, existence, point, direction, affordance = noisy_predictions(rng)
    slots = voted_slots(existence, point, direction, affordance)
    cosine = np.abs(np.einsum("ki,ki->k", slots.direction[:4], normals[:4]))
    assert (cosine > np.cos(0.02)).all()
    np.testing.assert_allclose(slots.point, point.mean(axis=0), atol=0.002)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_moving_the_predictions_moves_the_average(seed):
    rng = np.random.default_rng(seed)
    _, existence, point, direction, affordance = noisy_predictions(rng)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    here = voted_slots(existence, point, direction, affordance).transformed(T)
    there = voted_slots(
        existence, transform_points(T, point), rotate_vectors(T, direction), affordance
    )
    cosine = np.einsum("ki,ki->k", here.direction[:4], there.direction[:4])
    np.testing.assert_allclose(np.abs(cosine), 1.0, atol=1e-9)
    np.testing.assert_allclose(here.point, there.point, atol=0.002)  # medians turn with the axes
    np.testing.assert_allclose(here.existence, there.existence)


def test_points_without_affordance_do_not_vote():
    rng = np.random.default_rng(0)
    normals, existence, point, direction, affordance = noisy_predictions(rng)
    affordance[100:], direction[100:] = 0.0, unit(rng.normal(size=(100, 5, 3)))
    slots = voted_slots(existence, point, direction, affordance)
    assert (np.abs(np.einsum("ki,ki->k", slots.direction[:4], normals[:4])) > 0.999).all()


def test_the_weighted_median_ignores_outliers():
    assert weighted_medians(np.array([3.0, 1.0, 2.0, 900.0]), np.ones(4)) == 2.0
    assert weighted_medians(np.array([0.0, 5.0]), np.array([0.1, 1.0])) == 5.0


@given(seeds, st.integers(1, 40))
@settings(max_examples=25, deadline=None)
def test_half_of_the_weight_does_not_exceed_the_weighted_medians(seed, count):
    rng = np.random.default_rng(seed)
    values, weight = rng.integers(9, size=(2, 3, count)) / 8, rng.uniform(size=count)
    found = weighted_medians(values, weight)
    assert found.shape == (2, 3)
    for row, median in zip(values.reshape(6, count), found.reshape(6), strict=True):
        half = 0.5 * weight.sum()
        assert median == min(v for v in row if weight[row <= v].sum() >= half - 1e-12)


def test_the_votes_for_each_slot_are_averaged_as_if_it_were_alone():
    _, existence, point, direction, affordance = noisy_predictions(np.random.default_rng(5))
    existence[:, 1] = 0.0  # no point predicts one: all count
    slots = voted_slots(existence, point, direction, affordance)
    for slot in range(5):
        vote = affordance * existence[:, slot] if slot != 1 else affordance
        centre = weighted_medians(point[:, slot].T, vote)
        if slot < 4:
            d = direction[:, slot]
            axis = np.linalg.eigh((vote * d.T) @ d)[1][:, 2]
            axis = axis if axis[np.abs(axis).argmax()] > 0 else -axis
            np.testing.assert_allclose(slots.direction[slot], axis, atol=1e-12)
        if slot < 3:
            centre += (weighted_medians(point[:, slot] @ axis, vote) - centre @ axis) * axis
        np.testing.assert_allclose(slots.point[slot], centre, atol=1e-12)
    assert np.isnan(slots.direction[4]).all()


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_the_plain_mean_is_the_paper_s_average_whatever_the_signs(seed):
    rng = np.random.default_rng(seed)
    normals, existence, point, direction, _ = noisy_predictions(rng)
    slots = mean_slots(existence, point, direction)
    np.testing.assert_allclose(slots.existence, existence.mean(axis=0))
    np.testing.assert_allclose(slots.point, point.mean(axis=0))
    cosine = np.abs(np.einsum("ki,ki->k", slots.direction[:4], normals[:4]))
    assert (cosine > np.cos(0.02)).all()
