"""Laws of the dense symmetry error: zero for equal ones, signless, scale-free, frame-free."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.geometry.symmetry_error import symmetry_error
from pipelines.geometry.transforms import make_pose, random_rotation, transform_points, unit

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)


def random_pair(rng, kind):
    return [kind(unit(rng.normal(size=3)), rng.normal(size=3)) for _ in range(2)]


@few
@given(seeds, st.sampled_from([ReflectionSymmetry, RotationSymmetry]))
def test_a_symmetry_has_no_error_against_another_description_of_itself(seed, kind):
    rng = np.random.default_rng(seed)
    points, (truth, _) = rng.normal(size=(50, 3)), random_pair(rng, kind)
    along = (
        truth.direction
        if kind is RotationSymmetry
        else unit(np.cross(truth.direction, rng.normal(size=3)))
    )
    same = kind(-truth.direction, truth.point + rng.normal() * along)
    assert_allclose(symmetry_error(points, same, truth), 0.0, atol=1e-9)


@few
@given(seeds, st.sampled_from([ReflectionSymmetry, RotationSymmetry]))
def test_moving_and_scaling_everything_changes_no_error(seed, kind):
    rng = np.random.default_rng(seed)
    points, (predicted, truth) = rng.normal(size=(50, 3)), random_pair(rng, kind)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    moved = symmetry_error(
        transform_points(T, points), predicted.transformed(T), truth.transformed(T)
    )
    scaled = symmetry_error(
        points * 7.0,
        kind(predicted.direction, predicted.point * 7.0),
        kind(truth.direction, truth.point * 7.0),
    )
    before = symmetry_error(points, predicted, truth)
    assert_allclose([moved, scaled], before, rtol=1e-9)


def test_a_plane_shifted_by_its_distance_to_the_farthest_point_has_error_one():
    points = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    truth = ReflectionSymmetry(np.array([1.0, 0, 0]), np.zeros(3))
    shifted = ReflectionSymmetry(np.array([1.0, 0, 0]), np.array([1.0, 0, 0]))
    assert_allclose(symmetry_error(points, shifted, truth), 1.0)


def test_a_small_tilt_of_the_axis_costs_about_its_sine_at_half_a_turn(monkeypatch):
    monkeypatch.setattr("pipelines.geometry.symmetry_error.TURNS", (np.pi,))
    points = np.column_stack([np.zeros(3), np.zeros(3), [-1.0, 0.0, 1.0]])
    points[1] = (1.0, 0.0, 0.0)
    truth = RotationSymmetry(np.array([0, 0, 1.0]), np.zeros(3))
    tilted = RotationSymmetry(np.array([0.0, np.sin(0.1), np.cos(0.1)]), np.zeros(3))
    error = symmetry_error(points, tilted, truth)
    # Half a turn sends (0, 0, 1) to 2 sin(0.1) aside, (1, 0, 0) to itself negated both times.
    assert_allclose(error, 2 * (2 * np.sin(0.1)) / 3 / 2, rtol=1e-9)


@few
@given(seeds)
def test_the_error_of_an_axis_is_the_mean_over_fifteen_even_turns(seed):
    rng = np.random.default_rng(seed)
    points, (predicted, truth) = rng.normal(size=(20, 3)), random_pair(rng, RotationSymmetry)
    sign = np.sign(predicted.axis @ truth.axis)
    ratios = []
    for degrees in np.arange(22.5, 360.0, 22.5):
        true, found = (
            Rotation.from_rotvec(degrees * axis, degrees=True).apply(points - point) + point
            for axis, point in ((truth.axis, truth.point), (sign * predicted.axis, predicted.point))
        )
        reach = np.linalg.norm(true - points, axis=1).max()
        ratios.append(np.linalg.norm(found - true, axis=1).mean() / reach)
    assert len(ratios) == 15
    assert_allclose(symmetry_error(points, predicted, truth), np.mean(ratios))


def test_spheres_are_compared_by_the_distance_of_their_centres():
    near, far = SphereSymmetry(np.zeros(3)), SphereSymmetry(np.array([0.0, 0.3, 0.4]))
    assert_allclose(symmetry_error(np.ones((1, 3)), near, far), 0.5)


def test_symmetries_of_two_kinds_cannot_be_compared():
    with pytest.raises(ValueRangeError, match="reflection"):
        symmetry_error(
            np.ones((1, 3)),
            SphereSymmetry(np.zeros(3)),
            ReflectionSymmetry(np.array([0, 0, 1.0]), np.zeros(3)),
        )


def test_points_on_the_true_plane_allow_only_a_perfect_prediction():
    points = np.array([[0.0, 1.0, 0.0]])
    truth = ReflectionSymmetry(np.array([1.0, 0, 0]), np.zeros(3))
    shifted = ReflectionSymmetry(np.array([1.0, 0, 0]), np.array([0.1, 0, 0]))
    assert symmetry_error(points, truth, truth) == 0.0
    assert symmetry_error(points, shifted, truth) == np.inf
