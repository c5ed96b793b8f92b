"""Triangle meshes: measures known in closed form, even sampling, checked input."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.errors import ValueRangeError
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.transforms import make_pose, random_rotation

SIZE = np.array([0.06, 0.04, 0.1])
seeds = st.integers(0, 10_000)


def mesh_of(shape) -> Mesh:
    return Mesh(shape.vertices, shape.faces)


BOX = mesh_of(trimesh.creation.box(SIZE))
BALL = mesh_of(trimesh.creation.icosphere(4, 0.05))


def test_a_box_has_the_measures_of_a_box():
    assert BOX.volume == pytest.approx(SIZE.prod())
    assert BOX.area == pytest.approx(2 * (SIZE.prod() / SIZE).sum())
    assert BOX.diagonal == pytest.approx(np.linalg.norm(SIZE))
    assert_allclose(BOX.bounds, [-SIZE / 2, SIZE / 2])


def test_normals_point_out():
    centers = BALL.triangles.mean(axis=1)
    assert (np.einsum("fi,fi->f", BALL.face_normals, centers) > 0).all()
    assert_allclose(np.linalg.norm(BALL.face_normals, axis=1), 1.0)


def test_turning_the_faces_over_turns_the_volume_negative():
    assert Mesh(BOX.vertices, BOX.faces[:, ::-1]).volume == pytest.approx(-BOX.volume)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_moving_a_mesh_keeps_its_measures(seed):
    rng = np.random.default_rng(seed)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    moved = BOX.transformed(T)
    assert moved.volume == pytest.approx(BOX.volume)
    assert moved.area == pytest.approx(BOX.area)
    assert_allclose(moved.face_normals, BOX.face_normals @ T[:3, :3].T, atol=1e-12)


def test_a_mesh_with_a_missing_or_turned_triangle_is_not_watertight():
    assert BOX.is_watertight
    assert not BOX.submesh(np.arange(1, len(BOX.faces))).is_watertight
    faces = BOX.faces.copy()
    faces[3] = faces[3, ::-1]
    assert not Mesh(BOX.vertices, faces).is_watertight


def test_concatenation_keeps_every_triangle():
    both = Mesh.concatenate([BOX, BALL])
    assert_array_equal(both.triangles, np.concatenate([BOX.triangles, BALL.triangles]))
    assert both.is_watertight


def test_unused_vertices_do_not_widen_the_bounds():
    assert_allclose(Mesh([*BOX.vertices, [9.0, 9.0, 9.0]], BOX.faces).bounds, BOX.bounds)


def test_samples_lie_on_their_triangle():
    points, normals, index = sample_surface(BOX, 500, np.random.default_rng(0))
    assert_allclose(normals, BOX.face_normals[index])
    height = np.einsum("ni,ni->n", points - BOX.triangles[index, 0], normals)
    assert_allclose(height, 0.0, atol=1e-12)
    assert (np.abs(points) <= SIZE / 2 + 1e-12).all()


def test_samples_are_spread_by_area():
    _, _, index = sample_surface(BOX, 4000, np.random.default_rng(0))
    share = np.bincount(index, minlength=len(BOX.faces)) / 4000
    assert_allclose(share, BOX.face_areas / BOX.area, atol=1e-3)


def test_samples_reach_all_of_a_triangle():
    single = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    points, _, _ = sample_surface(single, 4000, np.random.default_rng(0))
    assert_allclose(points.mean(axis=0), [1 / 3, 1 / 3, 0], atol=0.02)


def test_the_same_generator_draws_the_same_samples():
    first, second = (sample_surface(BALL, 50, np.random.default_rng(4))[0] for _ in range(2))
    assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("vertices", "faces", "complaint"),
    [
        (np.zeros((3, 3)), np.zeros((0, 3), int), "without triangles"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], "not finite"),
        (np.zeros((3, 3)), [[0, 1, 3]], "beyond the vertices"),
        (np.zeros((3, 3)), [[0, 1, -1]], "beyond the vertices"),
    ],
)
def test_wrong_vertices_and_faces_are_refused(vertices, faces, complaint):
    with pytest.raises(ValueRangeError, match=complaint):
        Mesh(vertices, faces)
