"""Sums by the compiled loops of a fit, against numpy arrays."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pipelines.geometry.numerics.fitting_sums import (
    MATCH_NORMAL,
    MIN_SLOPE,
    REACH,
    SCALES,
    axis_sums,
    fitted_sphere,
    mirror_images,
    plane_sums,
    stepped,
)
from pipelines.geometry.numerics.nearest import Neighbors
from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.transforms import basis_from_direction, unit

SCALE = 0.012
EVERY = 3
MIDDLE = [0.1, -0.2, 0.7]


@pytest.fixture(params=[0, 1, 2], ids=["none", "one", "many"])
def case(request):
    """Points of a noisy ball and their normals; a few candidates near its middle."""
    rng = np.random.default_rng(request.param)
    count, starts = (0, 1, 240)[request.param], (0, 1, 5)[request.param]
    normals = unit(rng.normal(size=(count, 3)))
    points = 0.03 * normals + rng.normal(MIDDLE, 0.002, (count, 3))
    directions = unit(rng.normal(size=(starts, 3)))
    centers = rng.normal(MIDDLE, 0.005, (starts, 3))
    return points, normals, directions, centers


def sides_of(directions):
    return basis_from_direction(directions)[..., 1:].copy()


def sums_of(residual, rows, weight):
    """Return the sums of one candidate from residuals (n,), derivatives (n, 4), weights (n,)."""
    return (weight[:, None] * rows).T @ rows, (weight * residual) @ rows, weight.sum()


def biweight(residual, scale):
    return np.where(np.abs(residual) < scale, (1.0 - (residual / scale) ** 2) ** 2, 0.0)


def test_residuals_of_axes_are_distances_of_the_lines_of_normals(case):
    points, normals, axes, centers = case
    rows = np.concatenate([np.cross(points, normals), normals], axis=1)
    squares = (rows[:, :, None] * rows[:, None, :]).reshape(-1, 36)
    basis = sides_of(axes)
    found = axis_sums(rows, squares, axes, centers, basis, SCALE)
    for k, (axis, center) in enumerate(zip(axes, centers, strict=True)):
        sine = np.sqrt(np.maximum(1.0 - (normals @ axis) ** 2, MIN_SLOPE**2))
        lever = np.cross(points - center, normals)  # v x n . (p - c) = v . (p - c) x n
        residual = lever @ axis / sine
        turned = lever @ basis[k] / sine[:, None]
        shifted = -normals @ np.cross(axis, basis[k].T).T / sine[:, None]
        derivatives = np.concatenate([turned, shifted], axis=1)
        expected = sums_of(residual, derivatives, biweight(residual, SCALE))
        for part, whole in zip(found, expected, strict=True):
            assert_allclose(part[k], whole, rtol=1e-9, atol=1e-12)


def test_images_are_mirror_images_in_the_planes(case):
    points, _, normals, at = case
    images = mirror_images(points, normals, at)
    assert images.shape == (len(normals), len(points), 3)
    for k, plane in enumerate(zip(normals, at, strict=True)):
        assert_allclose(images[k], ReflectionSymmetry(*plane).counterpart(points), atol=1e-12)


def test_residuals_of_planes_are_distances_of_images_from_the_surface(case):
    points, normals, planes, at = case
    if not len(points):
        return  # without points there is no surface
    basis = sides_of(planes)
    moved, facing = points[::EVERY].copy(), normals[::EVERY]
    images = mirror_images(moved, planes, at)
    away, nearest = Neighbors.of(points).nearest(images)
    surface = points, normals, EVERY, images, away, nearest
    found = plane_sums(*surface, planes, at, basis, SCALE)
    for k, (m, point) in enumerate(zip(planes, at, strict=True)):
        met = normals[nearest[k]]
        residual = np.einsum("ni,ni->n", met, images[k] - points[nearest[k]])
        alike = np.einsum("ni,ni->n", met, facing - 2.0 * np.outer(facing @ m, m)) > MATCH_NORMAL
        beside = (away[k] > REACH) | (away[k] - np.abs(residual) > SCALES[0] / 2)
        weight = np.where(alike & ~beside, biweight(residual, SCALE), 0.0)
        foot = moved - point
        turned = (foot @ basis[k]) * (met @ m)[:, None] + (foot @ m)[:, None] * (met @ basis[k])
        offsets = np.stack([2.0 * met @ m, np.zeros(len(moved))], 1)
        rows = np.concatenate([-2.0 * turned, offsets], axis=1)
        for part, whole in zip(found, sums_of(residual, rows, weight), strict=True):
            assert_allclose(part[k], whole, rtol=1e-9, atol=1e-12)


def test_a_step_solves_for_all_unknowns_and_moves_the_starts(case):
    _, _, directions, points = case
    rng, size = np.random.default_rng(3), len(directions)
    rows = rng.normal(size=(size, 9, 4))
    sums = rows.swapaxes(1, 2) @ rows, rng.normal(size=(size, 4)), np.ones(size)
    total, precision = rng.normal(0, 0.1, (size, 4)), np.array([8.0, 8.0, 900.0, 700.0])
    basis = sides_of(directions)
    starts = directions, points, basis
    found, turned, moved = stepped(starts, basis, total, sums, 30.0, precision)
    for k in range(size):
        matrix = 30.0 * sums[0][k] + np.diag(precision)
        gradient = 30.0 * sums[1][k] + precision * total[k]
        assert_allclose(found[k], total[k] - np.linalg.solve(matrix, gradient), atol=1e-9)
        assert_allclose(turned[k], unit(directions[k] + basis[k] @ found[k, :2]), atol=1e-12)
        assert_allclose(moved[k], points[k] + basis[k] @ found[k, 2:], atol=1e-12)


def test_a_sphere_is_fitted_as_by_numpy_arrays(case):
    points, normals, _, _ = case
    if not len(points):
        return  # no radius
    start, share, precision = points.mean(axis=0) + 0.01, 7e4, 4e3
    found, weight = fitted_sphere(points, normals, start, np.array(SCALES), share, precision)
    center = start
    for scale in SCALES:
        foot = points - center
        distance = np.linalg.norm(foot, axis=1)
        passing = foot - np.einsum("ni,ni->n", foot, normals)[:, None] * normals
        known = biweight(np.linalg.norm(passing, axis=1), scale)
        known = np.where(np.abs(distance - np.median(distance)) < scale, known, 0.0)
        across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
        matrix = share * np.einsum("n,nij->ij", known, across) + precision * np.eye(3)
        pull = share * known @ passing + precision * (start - center)
        center = center + np.linalg.solve(matrix, pull)
    assert_allclose(found, center, atol=1e-9)
    assert weight == pytest.approx(known.sum())
