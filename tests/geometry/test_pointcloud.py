"""Planes, normals and thinning of point clouds."""

import numpy as np
from numpy.testing import assert_allclose

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import (
    Plane,
    estimate_normals,
    fit_plane_ransac,
    normals_from_organized,
    voxel_downsample,
)


def test_ransac_finds_a_plane_among_outliers():
    rng = np.random.default_rng(0)
    on_plane = np.c_[rng.uniform(-1, 1, (600, 2)), np.full(600, 0.8)]
    cloud = np.r_[on_plane, rng.uniform(-1, 1, (300, 3))]
    found = fit_plane_ransac(cloud, rng)
    assert found is not None
    plane, inliers = found
    assert_allclose(np.abs(plane.normal), [0, 0, 1], atol=1e-3)
    assert inliers[:600].all()
    assert inliers[600:].mean() < 0.05


def test_points_on_a_line_have_no_plane():
    line = np.linspace(0, 1, 50)[:, None] * np.array([1.0, 2.0, 3.0])
    assert fit_plane_ransac(line, np.random.default_rng(0)) is None


def test_a_plane_faces_the_viewpoint():
    plane = Plane(np.array([0.0, 0.0, 1.0]), -1.0)
    assert plane.facing([0, 0, 0]).height([0.0, 0.0, 0.0]) > 0
    assert_allclose(plane.facing([0, 0, 0]).height([0.0, 0.0, 3.0]), -2.0)


def test_normals_of_a_sphere_point_along_its_radius():
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    seen = directions[directions[:, 2] < -0.3]
    normals = estimate_normals(seen * 0.1 + [0, 0, 1.0])
    assert np.median(np.abs(np.einsum("ij,ij->i", normals, seen))) > 0.99
    assert (np.einsum("ij,ij->i", normals, seen) > 0).mean() > 0.99


def test_normals_of_a_tilted_plane_seen_by_a_camera():
    camera = Intrinsics(60, 60, 31.5, 23.5, 64, 48)
    normal = np.array([0.2, -0.5, -0.8])
    normal /= np.linalg.norm(normal)
    rays = camera.rays()
    depth = (np.array([0, 0, 1.0]) @ normal) / (rays @ normal)
    normals = normals_from_organized(camera.backproject(depth))
    assert_allclose(normals[20, 30], normal, atol=1e-9)
    assert np.isnan(normals[0, 0]).all()


def test_thinning_keeps_one_point_a_cube():
    cloud = np.array([[0, 0, 0], [0.001, 0, 0], [0.02, 0, 0]])
    assert voxel_downsample(cloud, 0.01).tolist() == [0, 2]
    assert voxel_downsample(np.zeros((0, 3)), 0.01).tolist() == []


def test_thinning_keeps_the_first_point_of_every_cube():
    points = np.random.default_rng(3).normal(0, 0.02, (700, 3))
    cubes = np.floor((points - points.min(axis=0)) / 0.01)
    expected = [i for i, c in enumerate(cubes) if not (cubes[:i] == c).all(axis=1).any()]
    np.testing.assert_array_equal(voxel_downsample(points, 0.01), expected)
