"""Laws of rigid transforms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.geometry.transforms import (
    basis_from_direction,
    cross,
    invert,
    make_pose,
    matrix_to_quaternion,
    quaternion_to_matrix,
    random_rotation,
    rotate_vectors,
    rotation_about,
    transform_points,
    unit,
)

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=25, deadline=None)


def random_pose(rng):
    return make_pose(random_rotation(rng), rng.normal(size=3))


@few
@given(seeds)
def test_a_transform_and_its_inverse_cancel(seed):
    rng = np.random.default_rng(seed)
    T, points = random_pose(rng), rng.normal(size=(5, 3))
    assert_allclose(transform_points(invert(T), transform_points(T, points)), points, atol=1e-12)


@few
@given(seeds)
def test_cross_products_of_one_vector_and_of_many_equal_numpys(seed):
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(4, 1, 3)), rng.normal(size=(5, 3))
    assert_allclose(cross(first, second), np.cross(first, second), atol=1e-14)
    assert_allclose(cross(first[0, 0], second[0]), np.cross(first[0, 0], second[0]), atol=1e-14)


@few
@given(seeds)
def test_transforms_compose_as_matrices(seed):
    rng = np.random.default_rng(seed)
    A, B, points = random_pose(rng), random_pose(rng), rng.normal(size=(5, 3))
    assert_allclose(
        transform_points(A @ B, points),
        transform_points(A, transform_points(B, points)),
        atol=1e-12,
    )


@few
@given(seeds)
def test_rotations_keep_lengths_and_handedness(seed):
    rng = np.random.default_rng(seed)
    R, v = random_rotation(rng), rng.normal(size=(4, 3))
    assert_allclose(np.linalg.norm(rotate_vectors(R, v), axis=1), np.linalg.norm(v, axis=1))
    assert_allclose(np.linalg.det(R), 1.0)


@few
@given(seeds)
def test_a_rotation_about_an_axis_leaves_the_axis_and_turns_by_its_angle(seed):
    rng = np.random.default_rng(seed)
    axis, angle = unit(rng.normal(size=3)), rng.uniform(0.0, np.pi)
    R = rotation_about(axis, angle)
    assert_allclose(R @ axis, axis, atol=1e-12)
    assert_allclose(np.trace(R), 1.0 + 2.0 * np.cos(angle), atol=1e-12)


@few
@given(seeds)
def test_quaternions_and_matrices_are_two_forms_of_one_rotation(seed):
    R = random_rotation(np.random.default_rng(seed))
    assert_allclose(quaternion_to_matrix(matrix_to_quaternion(R)), R, atol=1e-12)


@few
@given(seeds)
def test_a_basis_is_right_handed_and_starts_with_its_direction(seed):
    direction = unit(np.random.default_rng(seed).normal(size=3))
    basis = basis_from_direction(direction)
    assert_allclose(basis[:, 0], direction)
    assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)
    assert_allclose(np.linalg.det(basis), 1.0)


def test_the_unit_of_a_zero_vector_is_zero():
    assert_allclose(unit([0.0, 0.0, 0.0]), 0.0)


@pytest.mark.parametrize("shape", [(3,), (0, 3), (7, 3), (2, 5, 3)])
def test_unit_vectors_and_bases_of_many_equal_those_of_each(shape):
    vectors = np.random.default_rng(0).normal(size=shape).round(1)
    units, bases = unit(vectors), basis_from_direction(vectors)
    assert units.shape == shape
    assert bases.shape == (*shape, 3)
    for index in np.ndindex(*shape[:-1]):
        v = vectors[index]
        assert_allclose(units[index], v / np.linalg.norm(v), atol=1e-15)
        second = np.cross(np.eye(3)[np.abs(v).argmin()], v)
        expected = np.stack([v, second, np.cross(v, second)], 1)
        assert_allclose(bases[index], expected / np.linalg.norm(expected, axis=0), atol=1e-12)
