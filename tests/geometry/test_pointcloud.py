"""Planes of point clouds, draws and thinning."""

import numpy as np
from numpy.testing import assert_allclose

from pipelines.geometry.pointcloud import Plane, drawn_indices, voxel_downsample


def test_a_plane_faces_the_viewpoint():
    plane = Plane(np.array([0.0, 0.0, 1.0]), -1.0)
    assert plane.facing([0, 0, 0]).height([0.0, 0.0, 0.0]) > 0
    assert_allclose(plane.facing([0, 0, 0]).height([0.0, 0.0, 3.0]), -2.0)


def test_draws_repeat_a_point_only_if_there_are_too_few():
    many = drawn_indices(50, 20, np.random.default_rng(0))
    assert len(many) == len(set(many.tolist())) == 20
    few = drawn_indices(5, 20, np.random.default_rng(0))
    assert sorted(few[:5].tolist()) == [0, 1, 2, 3, 4]
    assert len(few) == 20
    assert set(few.tolist()) == set(range(5))


def test_thinning_keeps_one_point_per_cube():
    cloud = np.array([[0, 0, 0], [0.001, 0, 0], [0.02, 0, 0]])
    assert voxel_downsample(cloud, 0.01).tolist() == [0, 2]
    assert voxel_downsample(np.zeros((0, 3)), 0.01).tolist() == []


def test_thinning_keeps_the_first_point_of_every_cube():
    points = np.random.default_rng(3).normal(0, 0.02, (700, 3))
    cubes = np.floor((points - points.min(axis=0)) / 0.01)
    expected = [i for i, c in enumerate(cubes) if not (cubes[:i] == c).all(axis=1).any()]
    np.testing.assert_array_equal(voxel_downsample(points, 0.01), expected)
