"""Symmetries fitted to one view of surfaces whose symmetry is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.symmetry_fitting import fit_reflections, fit_rotations, fit_sphere
from pipelines.geometry.transforms import make_pose, random_rotation, rotate_vectors, unit
from pipelines.geometry.transforms import transform_points as moved

NOISE = 0.0008


def seen_of(points, normals, toward, rng):
    """The half of a surface that faces the viewer at `toward`, with sensor noise."""
    front = normals @ unit(toward) > 0.15
    noisy = points[front] + rng.normal(0, NOISE, (front.sum(), 3))
    tilted = unit(normals[front] + rng.normal(0, 0.05, (front.sum(), 3)))
    return noisy, tilted


def fit_rotation(start, points, normals):
    return fit_rotations([start], points, normals)[0]


def fit_reflection(start, points, normals):
    return fit_reflections([start], points, normals)[0]


def cylinder(rng, radius=0.03, height=0.12, n=2000):
    angle, z = rng.uniform(0, 2 * np.pi, n), rng.uniform(-height / 2, height / 2, n)
    normal = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], 1)
    return radius * normal + np.outer(z, [0, 0, 1]), normal


def ellipsoid(rng, axes=(0.05, 0.03, 0.02), n=2500):
    direction = unit(rng.normal(size=(n, 3)))
    return direction * axes, unit(direction / axes)


def degrees_between(a, b):
    return np.degrees(np.arccos(min(1.0, abs(float(unit(a) @ unit(b))))))


@pytest.mark.parametrize("seed", range(4))
def test_an_axis_twelve_degrees_off_is_brought_to_within_two(seed):
    rng = np.random.default_rng(seed)
    points, normals = seen_of(*cylinder(rng), [1.0, 0.3, 0.5], rng)
    off = unit(np.array([0, 0, 1.0]) + np.tan(np.radians(12)) * np.array([0.6, 0.8, 0]))
    fit = fit_rotation(RotationSymmetry(off, [0.008, -0.006, 0.01]), points, normals)
    assert degrees_between(fit.direction, [0, 0, 1]) < 2.0
    assert np.linalg.norm(np.cross(fit.point, fit.direction)) < 0.002
    assert fit.support > 0.6


@pytest.mark.parametrize("seed", range(4))
def test_a_plane_twelve_degrees_off_is_brought_to_within_three(seed):
    rng = np.random.default_rng(seed)
    points, normals = seen_of(*ellipsoid(rng), [0.2, 0.9, 1.0], rng)
    off = unit(np.array([1.0, 0, 0]) + np.tan(np.radians(12)) * np.array([0, 0.6, 0.8]))
    fit = fit_reflection(ReflectionSymmetry(off, [0.006, 0, 0]), points, normals)
    assert degrees_between(fit.direction, [1, 0, 0]) < 3.0
    assert abs(float(fit.point @ fit.direction)) < 0.002
    assert fit.support > 0.5


def test_a_sphere_is_found_from_the_side_that_is_seen():
    rng = np.random.default_rng(0)
    normals = unit(rng.normal(size=(2000, 3)))
    points, normals = seen_of(0.04 * normals, normals, [0, 0, -1.0], rng)
    fit = fit_sphere(np.array([0.01, -0.008, -0.01]), points, normals)
    assert np.linalg.norm(fit.point) < 0.003
    assert fit.support > 0.3  # normals err in two ways here, and both count


def test_a_plane_whose_far_side_is_hidden_stays_as_predicted():
    rng = np.random.default_rng(1)
    points, normals = seen_of(*ellipsoid(rng), [1.0, 0, 0], rng)
    kept = normals[:, 0] > 0.5  # the rim is not seen either
    prediction = ReflectionSymmetry(unit([1.0, 0.1, 0]), [0.004, 0, 0])
    fit = fit_reflection(prediction, points[kept], normals[kept])
    assert_allclose(fit.direction, prediction.normal)
    assert fit.support < 0.25


def test_a_plane_with_little_seen_on_its_far_side_stays_as_predicted():
    points, normals = ellipsoid(np.random.default_rng(2))
    kept = normals[:, 0] > 0.1  # images meet the surface near its rim only
    prediction = ReflectionSymmetry(unit([1.0, 0.1, 0]), [0.004, 0, 0])
    fit = fit_reflection(prediction, points[kept], normals[kept])
    assert 0.0 < fit.support < 0.25
    assert_allclose(fit.direction, prediction.normal)
    assert_allclose(fit.point, prediction.point)


def test_a_box_supports_no_rotation_as_a_can_does():
    rng = np.random.default_rng(2)
    faces = np.repeat(np.eye(3), 400, axis=0)
    points = rng.uniform(-0.04, 0.04, (1200, 3))
    points = np.where(faces > 0, 0.04, points)
    box = fit_rotation(RotationSymmetry([0, 0, 1], [0, 0, 0]), points, faces)
    can = fit_rotation(RotationSymmetry([0, 0, 1], [0, 0, 0]), *cylinder(rng))
    assert box.support < 0.5 < can.support


def test_moving_the_surface_moves_the_fit():
    rng = np.random.default_rng(3)
    points, normals = seen_of(*cylinder(rng), [1.0, 0.3, 0.5], rng)
    start = RotationSymmetry(unit([0.1, 0.1, 1.0]), [0.004, 0, 0])
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    still = fit_rotation(start, points, normals)
    turned = fit_rotation(start.transformed(T), moved(T, points), rotate_vectors(T, normals))
    assert degrees_between(turned.direction, rotate_vectors(T, still.direction)) < 1e-3
    assert_allclose(turned.support, still.support, atol=1e-6)


def test_starts_fitted_together_give_the_same_fits_as_alone():
    rng = np.random.default_rng(4)
    points, normals = seen_of(*ellipsoid(rng), [0.2, 0.9, 1.0], rng)
    planes = [ReflectionSymmetry(n, rng.normal(0, 0.004, 3)) for n in random_rotation(rng)]
    axes = [RotationSymmetry(n, rng.normal(0, 0.004, 3)) for n in random_rotation(rng)]
    for starts, together in ((planes, fit_reflections), (axes, fit_rotations)):
        for start, fit in zip(starts, together(starts, points, normals), strict=True):
            alone = together([start], points, normals)[0]
            assert_allclose(fit.direction, alone.direction, atol=1e-9)
            assert_allclose(fit.point, alone.point, atol=1e-9)
            assert fit.support == pytest.approx(alone.support)


def test_derivatives_of_the_residuals_lead_to_the_plane_in_few_steps():
    rng = np.random.default_rng(5)
    points, normals = ellipsoid(rng, n=1500)
    start = ReflectionSymmetry(unit([1.0, 0.06, -0.04]), [0.003, 0, 0])
    fit = fit_reflection(start, points, normals)
    assert degrees_between(fit.direction, [1, 0, 0]) < 0.6
    assert abs(float(fit.point @ fit.direction)) < 0.0005
