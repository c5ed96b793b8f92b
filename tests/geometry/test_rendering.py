"""Rays against meshes with known distances."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from pipelines.errors import ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import Scene, cast_view, first_hits
from pipelines.geometry.transforms import make_pose, random_rotation, unit

CAMERA = Intrinsics(80.0, 80.0, 31.5, 23.5, 64, 48)


def mesh_of(shape) -> Mesh:
    return Mesh(shape.vertices, shape.faces)


BOX = mesh_of(trimesh.creation.box((0.2, 0.2, 0.2)))
BALL = mesh_of(trimesh.creation.icosphere(5, 0.1))


def test_a_box_face_on_has_the_depth_of_its_front():
    hits = cast_view(Scene([BOX], [make_pose(np.eye(3), [0, 0, 1.0])]), CAMERA, np.eye(4))
    assert_allclose(hits.depth[23, 31], 0.9, atol=1e-12)
    assert_allclose(hits.normal[23, 31], [0, 0, -1])
    assert hits.depth[0, 0] == 0.0
    assert hits.object_index[0, 0] == hits.triangle_index[0, 0] == -1


def test_normals_are_toward_the_camera_also_from_inside():
    hits = cast_view(Scene([BOX], [np.eye(4)]), CAMERA, np.eye(4))
    assert_allclose(hits.depth[23, 31], 0.1, atol=1e-12)
    assert_allclose(hits.normal[23, 31], [0, 0, -1])


def test_the_nearer_object_hides_the_farther():
    scene = Scene([BOX, BALL], [make_pose(np.eye(3), t) for t in ([0.1, 0, 1.0], [0, 0, 0.5])])
    hits = cast_view(scene, CAMERA, np.eye(4))
    assert hits.object_index[23, 31] == 1
    assert set(np.unique(hits.object_index)) == {-1, 0, 1}
    assert hits.triangle_index[hits.object_index == 0].max() < len(BOX.faces)
    assert_allclose(hits.depth[23, 31], 0.4, atol=1e-3)


def test_moving_scene_and_camera_together_changes_nothing():
    rng = np.random.default_rng(0)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    pose = make_pose(random_rotation(rng), [0.02, 0.01, 0.8])
    still = cast_view(Scene([BOX], [pose]), CAMERA, np.eye(4))
    moved = cast_view(Scene([BOX], [T @ pose]), CAMERA, T)
    both = (still.object_index >= 0) & (moved.object_index >= 0)
    assert (both == (still.object_index >= 0)).mean() > 0.995
    same = both & (still.triangle_index == moved.triangle_index)
    assert_allclose(still.depth[same], moved.depth[same], atol=1e-9)


def test_distances_are_exact_to_double_precision():
    rng = np.random.default_rng(1)
    targets = rng.uniform(-0.09, 0.09, (500, 2))
    origins = np.c_[targets, np.full(500, -3.7)]
    distance, triangle = first_hits(BOX, origins, np.tile([0, 0, 2.0], (500, 1)))
    assert_allclose(distance, 3.6, atol=1e-12)
    assert (triangle >= 0).all()


def test_rays_that_miss_are_marked():
    distance, triangle = first_hits(BOX, [[1.0, 1.0, -1.0]], [[0, 0, 1.0]])
    assert distance[0] == np.inf
    assert triangle[0] == -1
    assert first_hits(BOX, np.zeros((0, 3)), np.zeros((0, 3)))[0].shape == (0,)


def test_rays_from_inside_a_ball_meet_it_a_radius_away():
    directions = unit(np.random.default_rng(2).normal(size=(200, 3)))
    distance, _ = first_hits(BALL, np.zeros((200, 3)), directions)
    assert_allclose(distance, 0.1, rtol=2e-3)


def test_occlusion_agrees_with_hits():
    rng = np.random.default_rng(3)
    scene = Scene([BALL], [np.eye(4)])
    origins, directions = rng.normal(size=(300, 3)), unit(rng.normal(size=(300, 3)))
    _, triangle = scene.cast(origins, directions)
    assert (scene.occluded(origins, directions) == (triangle >= 0)).mean() > 0.99


def test_a_scene_needs_objects():
    with pytest.raises(ValueRangeError, match="meshes and poses"):
        Scene([], [])
