"""Distances to a sampled surface against closed forms."""

import numpy as np
from numpy.testing import assert_allclose

from pipelines.geometry.surface import Surface, diameter
from pipelines.geometry.transforms import make_pose, random_rotation, transform_points
from tests.geometry.symmetric_shapes import ball, box


def test_the_distance_to_a_box_from_outside_is_that_to_its_clamped_point():
    rng, half = np.random.default_rng(0), np.array([0.06, 0.04, 0.025])
    points = rng.uniform(-0.15, 0.15, (400, 3))
    points = points[(np.abs(points) > half).any(axis=1)]
    surface = Surface.from_mesh(box(*(2 * half)), 20000, rng)
    expected = np.linalg.norm(points - points.clip(-half, half), axis=1)
    distance, _ = surface.distances(points)
    assert_allclose(distance, expected, atol=2e-4)


def test_normals_of_a_ball_look_away_from_its_centre():
    surface = Surface.from_mesh(ball(), 20000, np.random.default_rng(0))
    directions = surface.points / np.linalg.norm(surface.points, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", directions, surface.normals).min() > 0.99


def test_the_diameter_does_not_turn_with_the_mesh():
    rng, corners = np.random.default_rng(0), box(0.3, 0.4, 1.2).vertices
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    assert_allclose(diameter(corners), 1.3)
    assert_allclose(diameter(transform_points(T, corners)), 1.3)


def test_the_diameter_of_a_flat_sheet_is_its_diagonal():
    sheet = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [3, 4, 0]], float)
    assert_allclose(diameter(sheet), 5.0)
