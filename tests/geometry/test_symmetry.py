"""Symmetries as value types: their counterparts and their rigid motions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    SymmetrySlots,
)
from pipelines.geometry.transforms import make_pose, random_rotation, transform_points, unit

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)


def random_symmetries(rng):
    return [
        ReflectionSymmetry(unit(rng.normal(size=3)), rng.normal(size=3)),
        RotationSymmetry(unit(rng.normal(size=3)), rng.normal(size=3)),
        SphereSymmetry(rng.normal(size=3)),
    ]


@few
@given(seeds)
def test_the_counterpart_of_the_counterpart_is_the_point(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(6, 3))
    for symmetry in random_symmetries(rng):
        assert_allclose(symmetry.counterpart(symmetry.counterpart(points)), points, atol=1e-12)


@few
@given(seeds)
def test_moving_a_symmetry_moves_its_counterparts(seed):
    rng = np.random.default_rng(seed)
    T, points = make_pose(random_rotation(rng), rng.normal(size=3)), rng.normal(size=(6, 3))
    for symmetry in random_symmetries(rng):
        moved = symmetry.transformed(T).counterpart(transform_points(T, points))
        assert_allclose(moved, transform_points(T, symmetry.counterpart(points)), atol=1e-9)


@few
@given(seeds)
def test_the_antipode_is_the_farthest_point_of_the_orbit(seed):
    rng = np.random.default_rng(seed)
    axis = RotationSymmetry(unit(rng.normal(size=3)), rng.normal(size=3))
    point = rng.normal(size=3)
    orbit = np.stack([axis.turn(point, a) for a in np.linspace(0, 2 * np.pi, 360)])
    farthest = orbit[np.linalg.norm(orbit - point, axis=1).argmax()]
    assert_allclose(axis.counterpart(point), farthest, atol=0.05)
    reach = np.linalg.norm(orbit - point, axis=1).max()
    assert np.linalg.norm(axis.counterpart(point) - point) >= reach - 1e-9


def test_slots_hold_three_planes_one_axis_one_sphere():
    rng = np.random.default_rng(3)
    plane, axis, sphere = random_symmetries(rng)
    slots = SymmetrySlots.from_symmetries([axis, plane, plane, plane, plane, sphere])
    assert slots.probability.tolist() == [1, 1, 1, 1, 1]
    kinds = [slots.symmetry(slot).kind for slot in range(5)]
    assert kinds == [*["reflection"] * 3, "rotation", "sphere"]
    assert_allclose(slots.direction[3], axis.axis)


def test_symmetries_between_two_probabilities_leave_out_both_limits():
    plane, axis, sphere = random_symmetries(np.random.default_rng(4))
    slots = SymmetrySlots.of([(0, plane, 0.2), (1, plane, 0.5), (3, axis, 0.7), (4, sphere, 0.9)])
    assert [slot for slot, _ in slots.between(0.2)] == [1, 3, 4]
    assert [(slot, each.kind) for slot, each in slots.between(0.5, 0.9)] == [(3, "rotation")]


def test_discrete_rotations_have_no_slot():
    discrete = RotationSymmetry([0, 0, 1], [0, 0, 0], order=6)
    assert SymmetrySlots.from_symmetries([discrete]).probability.sum() == 0


def test_a_normal_without_a_direction_is_refused():
    with pytest.raises(ValueRangeError, match="normal"):
        ReflectionSymmetry([0, 0, 0], [0, 0, 0])
