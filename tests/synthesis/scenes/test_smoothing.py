"""Normals interpolated over triangles, for shading only."""

import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.transforms import make_pose, unit
from pipelines.synthesis.scenes.smoothing import barycentric, corner_normals, with_smooth_normals

CAMERA = Intrinsics(300.0, 300.0, 79.5, 59.5, 160, 120)
POSES = make_pose(np.eye(3), [0.0, 0.0, 0.6])[None]


def mesh_of(shape) -> Mesh:
    return Mesh(shape.vertices, shape.faces)


BALL = mesh_of(trimesh.creation.icosphere(3, 0.1))
BOX = mesh_of(trimesh.creation.box((0.1, 0.12, 0.14)))


def seen(mesh):
    hits = cast_view(Scene([mesh], list(POSES)), CAMERA, np.eye(4))
    return hits, with_smooth_normals(hits, [mesh], [corner_normals(mesh)], POSES, CAMERA)


def test_a_ball_of_triangles_gets_the_normals_of_a_sphere():
    hits, smooth = seen(BALL)
    hit = hits.object_index == 0
    points = (CAMERA.rays() * hits.depth[..., None])[hit]
    radial = unit(points - POSES[0, :3, 3])
    miss = [np.linalg.norm(view.normal[hit] - radial, axis=1) for view in (hits, smooth)]
    inner = np.abs(hits.normal[hit][:, 2]) > 0.3  # at the rim a normal may not face away
    assert miss[1][inner].max() < 0.02 < miss[0][inner].max()


def test_the_edges_of_a_box_stay_sharp():
    hits, smooth = seen(BOX)
    assert_allclose(smooth.normal, hits.normal, atol=1e-12)


def test_only_normals_change():
    hits, smooth = seen(BALL)
    assert_array_equal(smooth.depth, hits.depth)
    assert_array_equal(smooth.triangle_index, hits.triangle_index)


def test_no_normal_turns_away_from_the_camera():
    _, smooth = seen(BALL)
    assert (np.einsum("hwi,hwi->hw", smooth.normal, CAMERA.rays()) <= 0.0).all()


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_barycentric_shares_of_corners_reproduce_the_point(seed):
    rng = np.random.default_rng(seed)
    triangles, shares = rng.normal(size=(20, 3, 3)), rng.dirichlet(np.ones(3), 20)
    points = np.einsum("nk,nki->ni", shares, triangles)
    assert_allclose(barycentric(triangles, points), shares, atol=1e-6)
