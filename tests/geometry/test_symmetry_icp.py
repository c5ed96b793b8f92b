"""Parts of the symmetry fit: thinned surfaces, their rims, free space, duplicates."""

import numpy as np

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry_icp.planes import _largest_clique, _starting_normals
from pipelines.geometry.symmetry_icp.surface import FreeSpace, SeenSurface, largest_gaps

CAMERA = Intrinsics(100.0, 100.0, 31.5, 31.5, 64, 64)


def square(side=0.1, n=41):
    x, y = np.meshgrid(np.linspace(0, side, n), np.linspace(0, side, n))
    points = np.stack([x, y, np.full_like(x, 0.5)], -1).reshape(-1, 3)
    return SeenSurface(points, np.tile([0.0, 0.0, -1.0], (len(points), 1)))


def test_thinning_keeps_the_mean_of_each_cube():
    surface = SeenSurface(np.array([[0, 0, 0], [0.001, 0, 0], [0.02, 0, 0]]), np.eye(3)[[2, 2, 0]])
    thin = surface.thinned(0.005)
    np.testing.assert_allclose(thin.points, [[0.0005, 0, 0], [0.02, 0, 0]])
    np.testing.assert_allclose(thin.normals, [[0, 0, 1], [1, 0, 0]])


def test_the_rim_of_a_square_is_removed_and_its_middle_stays():
    inner = square().without_rim().points
    assert inner[:, :2].min() > 0.0075
    assert inner[:, :2].max() < 0.0925
    assert len(inner) > 0.5 * 41**2


def test_the_largest_gap_goes_around():
    assert np.isclose(largest_gaps(np.radians([10.0, 100.0, 350.0])), np.radians(250.0))


def test_points_in_front_of_the_seen_surface_are_in_free_space_and_points_behind_are_not():
    space = FreeSpace.around(square().points, np.full((64, 64), 0.5), CAMERA)
    error = space.occupancy_error(np.array([[0.05, 0.05, 0.44], [0.05, 0.05, 0.55]]))
    np.testing.assert_array_equal(error, [1.0, 0.0])


def test_pixels_without_depth_are_no_free_space():
    space = FreeSpace.around(square().points, np.zeros((64, 64)), CAMERA)
    assert space.occupancy_error(np.array([[0.05, 0.05, 0.44]])) == 0.0


def test_points_beneath_the_table_are_errors():
    table = Plane(np.array([0.0, 0.0, -1.0]), 0.52)
    space = FreeSpace.around(square().points, np.zeros((64, 64)), CAMERA, table)
    assert space.occupancy_error(np.array([[0.05, 0.05, 0.6]])) == 1.0


def test_starting_normals_spread_over_the_hemisphere():
    normals = _starting_normals(np.random.default_rng(0).normal(size=(50, 3)) * [3, 2, 1])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    directions = np.random.default_rng(1).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    nearest = np.degrees(np.arccos(np.abs(directions @ normals.T).max(axis=1).clip(0, 1)))
    assert nearest.max() < 36.0


def test_the_largest_group_of_similar_fits_is_found():
    alike = np.eye(5, dtype=bool)
    for i, j in [(0, 1), (1, 2), (2, 3), (1, 3)]:
        alike[i, j] = alike[j, i] = True
    assert _largest_clique(set(), set(range(5)), alike) == {1, 2, 3}
