"""True labels passed through the post-processing of compared methods."""

import numpy as np
import pytest

from pipelines.dataset.graspnet.graspnet_views import view_rotations
from pipelines.dataset.meshes import read_mesh
from pipelines.geometry.meshes.mesh import sample_surface
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.grasps_stream import read_results
from pipelines.grasping.peers.rectangles import rectangle_hits, rectangle_rows
from tests.stages.toy_grasp_labels import write_labels, write_rects
from tests.stages.toy_root import best_grasp, frame_names, write_root
from tools.peer_oracle import METHODS, REPRESENTATIONS, write_oracle


@pytest.mark.parametrize("name", REPRESENTATIONS)
def test_true_rectangles_are_decoded_correctly(name):
    represented, _ = REPRESENTATIONS[name]
    sizes = np.full(2, 60.0), np.full(2, 30.0), np.array([1.0, 0.7])
    rows = rectangle_rows(np.array([[150.0, 200.0], [400.0, 300.0]]), np.array([0.3, -1.0]), *sizes)
    found = represented(rows, (480, 640))
    assert len(found) == 2
    assert rectangle_hits(found, rows).all()


def test_every_method_has_its_oracle():
    assert set(METHODS) == {"gg-cnn", "multi-grasp", "graspnet"}


def test_hands_of_graspnet_are_labelled_hands_of_their_object(tmp_path):
    root = write_root(tmp_path / "root")
    write_labels(root)
    out, name = tmp_path / "oracle.h5", frame_names()[0]
    write_oracle("graspnet", root, out, 1)
    (result,) = read_results(out, [0])
    poses = {pose.object_id: pose.T_cam_obj for pose in root.read_annotation(root.frame(name))}
    labelled = view_rotations().reshape(-1, 9)
    for object_id in (0, 1):  # no grasp holds the ball
        distance = surface_distance(root, object_id, poses[object_id], result.grasps.translation)
        rotations = result.grasps.rotation[distance < 0.03]
        assert len(rotations)
        in_object = (poses[object_id][:3, :3].T @ rotations).reshape(-1, 1, 9)
        assert (np.abs(in_object - labelled).max(axis=2).min(axis=1) < 1e-4).all()


def surface_distance(root, object_id, pose, places):
    mesh = read_mesh(root.model_path(object_id))
    points = transform_points(pose, sample_surface(mesh, 500, np.random.default_rng(0))[0])
    return np.linalg.norm(points - places[:, None], axis=2).min(axis=1)


@pytest.mark.parametrize("name", REPRESENTATIONS)
def test_the_labelled_grasps_of_a_dataset_are_written(name, tmp_path):
    root = write_root(tmp_path / "root")
    write_rects(root)
    out = tmp_path / "oracle.h5"
    assert write_oracle(name, root, out, 1000) == len(frame_names())
    for number, result in enumerate(read_results(out, range(len(frame_names())))):
        assert set(result.grasps.source) == {name}
        middles = [best_grasp(i, number % 2).translation[0] for i in (0, 1, 2)]
        distances = np.linalg.norm(result.grasps.translation[:, None] - middles, axis=2)
        assert (distances.min(axis=0) < 0.04).all()
