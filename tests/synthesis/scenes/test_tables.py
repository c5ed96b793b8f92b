"""Settled scenes and their recordings by cameras."""

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from pipelines.errors import UnknownNameError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.transforms import make_pose, transform_points
from pipelines.synthesis.scenes.cameras import drawn_viewpoints, look_at, sensor_intrinsics
from pipelines.synthesis.scenes.depth_sensors import measured_depth
from pipelines.synthesis.scenes.settling import drop_objects
from pipelines.synthesis.scenes.tables import SceneLayout, SceneObject, record, rectangle, settle

CAMERA = Intrinsics(150.0, 150.0, 79.5, 59.5, 160, 120)
CUBOID = trimesh.creation.box((0.06, 0.08, 0.1))
BOX = Mesh(CUBOID.vertices, CUBOID.faces)


def boxes(count):
    return [SceneObject(i, f"{i:03d}", BOX, (BOX,)) for i in range(count)]


def test_dropped_boxes_rest_on_the_table_and_do_not_interpenetrate():
    settled = drop_objects([(BOX,)] * 4, np.random.default_rng(0))
    assert len(settled.index) >= 3
    clouds = [transform_points(pose, BOX.vertices) for pose in settled.poses]
    assert min(cloud[:, 2].min() for cloud in clouds) > -0.003
    assert sum(abs(cloud[:, 2].min()) < 0.003 for cloud in clouds) >= 2
    for i, pose in enumerate(settled.poses):
        for j, cloud in enumerate(clouds):
            inside = (
                np.abs((cloud - pose[:3, 3]) @ pose[:3, :3]) < np.array([0.03, 0.04, 0.05]) - 0.003
            )
            assert i == j or not inside.all(axis=1).any()


def test_the_same_seed_settles_the_same_scene():
    first = settle(boxes(3), np.random.default_rng(5))
    again = settle(boxes(3), np.random.default_rng(5))
    assert_allclose(first.poses, again.poses, atol=0)


def test_cameras_look_at_the_scene_from_above():
    lens = sensor_intrinsics("realsense", 640, 480)
    for pose in drawn_viewpoints([0.05, 0, 0.04], 6, lens, np.random.default_rng(1)):
        assert pose[2, 3] > 0.2
        pixel = lens.project((np.array([0.05, 0, 0.04]) - pose[:3, 3]) @ pose[:3, :3])
        assert (np.abs(pixel - [320, 240]) < [250, 200]).all()


def test_look_at_keeps_the_world_upright_in_the_image():
    pose = look_at([0.5, 0, 0.5], [0, 0, 0])
    assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-12)
    above = (np.array([0, 0, 0.1]) - pose[:3, 3]) @ pose[:3, :3]
    assert above[1] < 0  # y points down


def test_graspnets_cameras_have_their_own_image_size():
    assert_allclose(sensor_intrinsics("kinect", 1280, 720).fx, 631.54864502)
    assert_allclose(sensor_intrinsics("realsense", 1280, 720).cy, 349.62133789)
    with pytest.raises(UnknownNameError, match="lidar"):
        sensor_intrinsics("lidar", 640, 480)


def test_a_recorded_view_has_labels_where_the_objects_are():
    layout = SceneLayout(tuple(boxes(1)), make_pose(np.eye(3), [0, 0, 0.05])[None])
    pose = look_at([0.4, 0, 0.5], [0, 0, 0.05])[None]
    (view,) = record(layout, pose, CAMERA, "perfect", np.random.default_rng(0))
    assert view.object_index[60, 80] == 0
    assert (view.object_index == -1).any()
    height = transform_points(view.T_world_cam, CAMERA.backproject(view.depth)[60, 80])[2]
    assert 0.0 < height < 0.101
    table = transform_points(view.T_world_cam, CAMERA.backproject(view.depth)[110, 80])
    assert_allclose(table[2], 0.0, atol=1e-9)
    assert view.color.std() > 3


@pytest.mark.parametrize(("sensor", "noise"), [("kinect", 0.004), ("realsense", 0.003)])
def test_sensors_are_right_on_average_and_lose_depth_at_edges(sensor, noise):
    T_world_cam = look_at([0.0, -0.5, 0.6], [0, 0, 0])
    scene = Scene([BOX, rectangle(1, 1)], [make_pose(np.eye(3), [0, 0, 0.05]), np.eye(4)])
    hits = cast_view(scene, CAMERA, T_world_cam)
    depth = measured_depth(sensor, scene, hits, CAMERA, T_world_cam, np.random.default_rng(2))
    seen = depth > 0
    error = (depth - hits.depth)[seen]
    assert 0.8 < seen.mean() < 0.999
    assert np.median(np.abs(error)) < noise
    assert abs(np.median(error)) < 0.001
    assert (depth[~seen] == 0).all()


@pytest.mark.parametrize("sensor", ["kinect", "realsense"])
def test_no_depth_is_made_up_at_the_border_of_a_surface(sensor):
    T_world_cam = look_at([0.0, -0.9, 0.25], [0, 0, 0.1])  # over the table's far end, into nothing
    scene = Scene([rectangle(1, 1)], [np.eye(4)])
    hits = cast_view(scene, CAMERA, T_world_cam)
    nearest = hits.depth[hits.depth > 0].min()
    assert 0.2 < (hits.depth > 0).mean() < 0.8
    for seed in range(5):
        rng = np.random.default_rng(seed)
        depth = measured_depth(sensor, scene, hits, CAMERA, T_world_cam, rng)
        assert depth[depth > 0].min() > 0.9 * nearest


def test_a_perfect_sensor_reports_the_truth_and_an_unknown_one_is_refused():
    scene = Scene([rectangle(1, 1)], [np.eye(4)])
    T_world_cam = look_at([0.0, -0.5, 0.6], [0, 0, 0])
    hits = cast_view(scene, CAMERA, T_world_cam)
    rng = np.random.default_rng(0)
    assert measured_depth("perfect", scene, hits, CAMERA, T_world_cam, rng) is hits.depth
    with pytest.raises(UnknownNameError, match="kinect"):
        measured_depth("lidar", scene, hits, CAMERA, T_world_cam, rng)
