"""The diameter of a point set equals the largest of all distances, in any pose."""

import numpy as np
import trimesh
from numpy.testing import assert_allclose

from pipelines.geometry.meshes.diameter import diameter
from pipelines.geometry.transforms import make_pose, random_rotation, transform_points
from tests.geometry.symmetric_shapes import box


def test_the_diameter_does_not_change_when_the_mesh_turns():
    rng, corners = np.random.default_rng(0), box(0.3, 0.4, 1.2).vertices
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    assert_allclose(diameter(corners), 1.3)
    assert_allclose(diameter(transform_points(T, corners)), 1.3)


def test_the_diameter_of_a_flat_sheet_is_its_diagonal():
    sheet = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [3, 4, 0]], float)
    assert_allclose(diameter(sheet), 5.0)


def test_the_diameter_includes_the_tip_of_a_cone_among_thousands_of_corners():
    cone = trimesh.creation.cone(0.03, 0.2, sections=2400)
    assert_allclose(diameter(np.asarray(cone.vertices)), np.hypot(0.03, 0.2), rtol=1e-9)


def test_the_diameter_of_a_fine_ball_and_of_a_tip_on_it_is_a_thousandth_short_at_most():
    corners = np.asarray(trimesh.creation.icosphere(5, 1.0).vertices)
    assert len(corners) > 10_000
    assert_allclose(diameter(corners), 2.0, rtol=1e-3)
    assert_allclose(diameter(np.vstack([corners, [[0.0, 0.0, 4.0]]])), 5.0, rtol=1e-3)


def test_the_diameter_is_the_largest_of_all_distances():
    for count in (1, 2, 5, 300):
        points = np.random.default_rng(count).normal(size=(count, 3))
        apart = np.linalg.norm(points[:, None] - points[None], axis=2)
        assert_allclose(diameter(points), apart.max(), rtol=1e-9)
