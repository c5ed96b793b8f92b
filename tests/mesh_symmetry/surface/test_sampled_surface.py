"""Distances to a sampled surface against closed forms."""

import numpy as np
from numpy.testing import assert_allclose

from pipelines.mesh_symmetry.surface.sampled_surface import Surface
from tests.geometry.symmetric_shapes import ball, box


def test_the_distance_to_a_box_from_outside_is_the_distance_to_the_clamped_point():
    rng, half = np.random.default_rng(0), np.array([0.06, 0.04, 0.025])
    points = rng.uniform(-0.15, 0.15, (400, 3))
    points = points[(np.abs(points) > half).any(axis=1)]
    surface = Surface.from_mesh(box(*(2 * half)), 20000, rng)
    expected = np.linalg.norm(points - points.clip(-half, half), axis=1)
    distance, _ = surface.distances(points)
    assert_allclose(distance, expected, atol=2e-4)


def test_normals_of_a_ball_point_away_from_its_centre():
    surface = Surface.from_mesh(ball(), 20000, np.random.default_rng(0))
    directions = surface.points / np.linalg.norm(surface.points, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", directions, surface.normals).min() > 0.99
