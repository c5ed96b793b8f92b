"""Signed-distance grids against shapes whose distance is known."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pipelines.dataset.graspnet.signed_distance import read_sdf, write_sdf
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.signed_distance import (
    NARROW_BAND,
    signed_distance_grid,
)
from tests.geometry.meshes.closest import closest_points

SIZE = np.array([0.06, 0.04, 0.1])


def mesh_of(shape) -> Mesh:
    return Mesh(shape.vertices, shape.faces)


def places(grid):
    nodes = np.moveaxis(np.indices(grid.values.shape), 0, -1)
    return grid.origin + grid.spacing * nodes


@pytest.fixture(scope="module")
def box():
    return signed_distance_grid(mesh_of(trimesh.creation.box(SIZE)), nodes=40)


def test_the_grid_follows_the_recipe_of_dexnet():
    mesh = mesh_of(trimesh.creation.box(SIZE).apply_translation([1.0, 2.0, 3.0]))
    grid = signed_distance_grid(mesh)
    assert grid.values.shape == (100, 100, 100)
    assert_allclose(grid.spacing, 0.1 / 90)
    assert_allclose(grid.origin, np.array([1.0, 2.0, 3.0]) - 50 * 0.1 / 90)


def test_a_box_has_its_distances_inside_and_outside(box):
    beyond = np.abs(places(box)) - SIZE / 2
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    assert_allclose(box.values, outside + np.minimum(beyond.max(axis=-1), 0.0), atol=1e-9)


def test_a_tube_is_open_inside():
    tube = trimesh.creation.annulus(0.02, 0.04, 0.05, sections=64)
    grid = signed_distance_grid(mesh_of(tube), nodes=50)
    at = places(grid)
    radius, height = np.linalg.norm(at[..., :2], axis=-1), np.abs(at[..., 2])
    beyond = np.stack([np.abs(radius - 0.03) - 0.01, height - 0.025], -1)
    exact = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(-1), 0.0)
    near = np.abs(exact) < (NARROW_BAND - 0.5) * grid.spacing
    assert np.abs(grid.values - exact)[near].max() < 1e-4  # error of a polygon of 64 sides
    assert np.abs(grid.values - exact).max() < grid.spacing
    assert ((grid.values < 0) == (exact < 0))[np.abs(exact) > 1e-4].all()


def test_a_grid_survives_being_written_and_read(box, tmp_path):
    write_sdf(tmp_path / "textured.sdf", box)
    assert_allclose(read_sdf(tmp_path / "textured.sdf").values, box.values, rtol=1e-5, atol=1e-9)


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_closest_points_agree_with_trimesh(seed):
    rng = np.random.default_rng(seed)
    triangles, points = rng.normal(size=(50, 3, 3)), 2.0 * rng.normal(size=(50, 3))
    expected = trimesh.triangles.closest_point(triangles, points)
    assert_allclose(closest_points(triangles, points), expected, atol=1e-9)


def test_distances_near_a_turned_box_are_exact_to_a_ten_thousandth_of_the_spacing(tmp_path):
    turn = trimesh.transformations.euler_matrix(0.3, 0.5, 0.7)
    grid = signed_distance_grid(mesh_of(trimesh.creation.box(SIZE).apply_transform(turn)))
    write_sdf(tmp_path / "textured.sdf", grid)
    read = read_sdf(tmp_path / "textured.sdf")  # its file has six digits
    beyond = np.abs(places(grid) @ turn[:3, :3]) - SIZE / 2
    exact = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(-1), 0.0)
    near = np.abs(exact) < NARROW_BAND * grid.spacing
    assert np.abs(read.values - exact)[near].max() < 1e-4 * grid.spacing
    assert ((read.values < 0) == (exact < 0))[np.abs(exact) > 1e-4 * grid.spacing].all()


def test_distances_to_a_ball_are_exact_up_to_its_facets():
    ball = trimesh.creation.icosphere(4, 0.03)
    grid = signed_distance_grid(mesh_of(ball), nodes=40)
    exact = np.linalg.norm(places(grid), axis=-1) - 0.03
    assert np.abs(grid.values - exact)[np.abs(exact) < 2 * grid.spacing].max() < 1.2e-4
    assert ((grid.values < 0) == (exact < 0))[np.abs(exact) > 1.2e-4].all()


@pytest.mark.parametrize("missing", [1, 12])
def test_a_ball_with_holes_has_an_inside_too(missing):
    ball = mesh_of(trimesh.creation.icosphere(3, 0.03))
    torn = ball.submesh(np.random.default_rng(0).permutation(len(ball.faces))[missing:])
    assert not torn.is_watertight
    grid = signed_distance_grid(torn, nodes=40)
    exact = np.linalg.norm(places(grid), axis=-1) - 0.03
    wrong = ((grid.values < 0) != (exact < 0)) & (np.abs(exact) > grid.spacing)
    assert wrong.mean() < 1e-3


@pytest.mark.parametrize("corners", [(0, 0, 1), (2, 2, 2), (0, 1, 8)])
def test_triangles_of_no_area_change_nothing(box, corners):
    mesh = mesh_of(trimesh.creation.box(SIZE))
    middle = mesh.vertices[:2].mean(axis=0, keepdims=True)  # vertex 8, on a straight line
    more = Mesh(np.concatenate([mesh.vertices, middle]), np.concatenate([mesh.faces, [corners]]))
    assert_allclose(signed_distance_grid(more, nodes=40).values, box.values, atol=1e-12)


def test_the_search_ends_for_two_coincident_copies_of_a_mesh():
    # Coincident triangles: the search for the next surface must get past both.
    ball = mesh_of(trimesh.creation.icosphere(3, 0.03))
    twice = Mesh(np.tile(ball.vertices, (2, 1)), np.concatenate([ball.faces, ball.faces + 642]))
    grid = signed_distance_grid(twice, nodes=30)
    assert np.isfinite(grid.values).all()
