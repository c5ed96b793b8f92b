"""Rotations that follow from mirror planes and turns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.geometry.rotation_group import implied_rotations, turn_of
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.geometry.transforms import make_pose, random_rotation, rotation_about

X, Y, Z = np.eye(3)
PLACE = np.array([0.02, -0.05, 0.11])
seeds = st.integers(0, 2**32 - 1)


def mirrors(*normals):
    return [ReflectionSymmetry(normal, PLACE) for normal in normals]


def orders(transforms):
    return sorted(round(360 / np.degrees(turn_of(T)[1]), 3) for T in transforms)


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(2, 12))
def test_an_n_fold_axis_gives_n_minus_1_turns_about_itself(seed, order):
    rng = np.random.default_rng(seed)
    axis, point = random_rotation(rng)[0], rng.uniform(-1, 1, 3)
    found = implied_rotations([RotationSymmetry(axis, point, order)]).discrete
    assert len(found) == order - 1
    angles = []
    for T in found:
        assert np.allclose(T[:3, :3] @ point + T[:3, 3], point)
        assert np.allclose(T[:3, :3] @ axis, axis)
        angles.append(round(turn_of(T)[1] * order / (2 * np.pi), 6))
    wanted = sorted(min(k, order - k) for k in range(1, order))
    assert sorted(angles) == pytest.approx(wanted)


def test_one_mirror_implies_no_rotation():
    assert len(implied_rotations(mirrors(X)).discrete) == 0


def test_two_perpendicular_mirrors_make_a_half_turn_and_no_reflection():
    (T,) = implied_rotations(mirrors(X, Y)).discrete
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert np.allclose(T[:3, :3], np.diag([-1, -1, 1]))
    assert np.allclose(T[:3, :3] @ PLACE + T[:3, 3], PLACE)


def test_three_perpendicular_mirrors_make_three_half_turns():
    assert orders(implied_rotations(mirrors(X, Y, Z)).discrete) == [2, 2, 2]


def test_mirrors_60_degrees_apart_make_the_turns_of_a_triangle():
    third = rotation_about(Z, np.pi / 3) @ X
    assert orders(implied_rotations(mirrors(X, third)).discrete) == [3, 3]


def test_a_square_prism_has_seven_turns():
    square = [*mirrors(X, Z), RotationSymmetry(Z, PLACE, 4)]
    assert orders(implied_rotations(square).discrete) == [2, 2, 2, 2, 2, 4, 4]


def test_a_quarter_turn_about_two_axes_makes_the_24_of_a_cube():
    cube = [RotationSymmetry(X, PLACE, 4), RotationSymmetry(Z, PLACE, 4)]
    assert len(implied_rotations(cube).discrete) == 23


def test_mirrors_at_an_odd_angle_form_no_group():
    odd = [*mirrors(X, rotation_about(Z, 0.3) @ X, rotation_about(Y, 0.7) @ X)]
    assert len(implied_rotations(odd).discrete) == 0


def test_small_errors_of_the_mirrors_do_not_make_more_turns():
    tilt = rotation_about([1, 1, 0], np.radians(0.5))
    found = implied_rotations(mirrors(X, tilt @ Y, tilt.T @ Z)).discrete
    assert len(found) == 3
    assert all(turn_of(T)[1] == pytest.approx(np.pi, abs=1e-6) for T in found)


def test_a_round_axis_swaps_its_ends_only_with_a_mirror_across_it():
    axis = RotationSymmetry(Z, PLACE)
    alone = implied_rotations([axis])
    assert alone.continuous == (axis,)
    assert len(alone.discrete) == 0
    across = ReflectionSymmetry(Z, PLACE + np.array([0.3, 0.1, 0.02]))
    (flip,) = implied_rotations([across, axis]).discrete
    assert np.allclose(flip[:3, :3] @ Z, -Z)
    end = PLACE + 0.05 * Z
    assert np.allclose(flip[:3, :3] @ end + flip[:3, 3], PLACE + (0.04 - 0.05) * Z)


def test_a_sphere_gives_three_axes_through_its_centre():
    found = implied_rotations([SphereSymmetry(PLACE)])
    assert np.allclose([axis.axis for axis in found.continuous], np.eye(3))
    assert len(found.discrete) == 0


@settings(max_examples=50, deadline=None)
@given(seeds, st.integers(1, 11), st.integers(2, 12))
def test_axis_angle_and_point_are_recovered_from_the_transform(seed, steps, order):
    rng = np.random.default_rng(seed)
    axis, point = random_rotation(rng)[0], rng.uniform(-1, 1, 3)
    angle = 2 * np.pi * (1 + steps % (order - 1)) / order if order > 2 else np.pi
    R = rotation_about(axis, angle)
    found, turned, place = turn_of(make_pose(R, point - R @ point))
    assert np.allclose(rotation_about(found, turned), R, atol=1e-6)
    assert np.linalg.norm(np.cross(place - point, axis)) < 1e-6
