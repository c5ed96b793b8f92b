"""Labels of GraspNet's baseline at the points of a frame, and a training that overfits one."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from pipelines.configs import TrainBaselineConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_labels import (
    read_collision_labels,
    write_collision_labels,
)
from pipelines.dataset.graspnet.graspnet_views import generate_views
from pipelines.dataset.training.region_frames import FrameSets
from pipelines.errors import FormatError, ValueRangeError
from pipelines.learning.peers import graspnet_labels
from pipelines.learning.peers.graspnet_clouds import labelled_scene
from pipelines.learning.peers.graspnet_labels import (
    DENSE_POINTS,
    graspnet_frame_arrays,
    holding_cells,
    tolerances,
)
from pipelines.learning.peers.graspnet_training import (
    GraspNetTraining,
    mean_terms,
)
from pipelines.learning.peers.peer import write_peer_frames
from pipelines.learning.peers.pointnetgpd_training import pointnetgpd_frame
from pipelines.learning.speed.processes import Processes
from pipelines.storage.provenance import make_stamp
from tests.learning.by_heart import learned
from tests.stages.toy_grasp_labels import FRICTION, NUM_LABELLED, write_labels
from tests.stages.toy_root import frame_names, write_root

CONFIG = TrainBaselineConfig().with_schedule(GraspNetTraining.peer.schedule)
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = write_root(tmp_path_factory.mktemp("root"))
    write_labels(root)
    return root


@pytest.fixture(scope="module")
def frame(root):
    return graspnet_frame_arrays(root, root.frame(frame_names()[0]))


def test_holding_grasps_are_kept_with_their_friction_and_width(root):
    held = holding_cells(root.grasp_label_path(0))
    assert len(held.point) == NUM_LABELLED * 14_400
    assert set(held.friction.tolist()) == {round(100 * FRICTION[0])}
    assert set(held.width.tolist()) == {70}
    assert not len(holding_cells(root.grasp_label_path(2)).point)  # no grasp holds the ball


def test_points_too_far_to_be_stored_do_not_come_near(root, frame, monkeypatch):
    read = GraspNetRoot.read_depth

    def with_far_corner(self, files):
        depth, intrinsics = read(self, files)
        depth = depth.copy()
        depth[0, 0] = 5.0
        return depth, intrinsics

    boxed = graspnet_labels.boxed_points

    def with_corner(scene):
        mask = boxed(scene).copy()
        mask[0, 0] = True
        return mask

    monkeypatch.setattr(GraspNetRoot, "read_depth", with_far_corner)
    monkeypatch.setattr(graspnet_labels, "boxed_points", with_corner)
    again = graspnet_frame_arrays(root, root.frame(frame_names()[0]))
    assert again["cloud"][:, 2].min() > 0
    assert len(again["cloud"]) == len(again["on_object"])


def test_no_more_labelled_points_are_left_out_than_the_limit_asks(root, frame, monkeypatch):
    seen = np.bincount(frame["object"])
    monkeypatch.setattr(graspnet_labels, "LEAST_KEPT", int(seen.max()) - 1)
    monkeypatch.setattr(graspnet_labels, "KEPT_SHARE", 0.0)
    kept = graspnet_frame_arrays(root, root.frame(frame_names()[0]))["object"]
    assert_allclose(np.bincount(kept), np.minimum(seen, seen.max() - 1))


def test_colliding_hands_are_no_labels(tmp_path):
    root = write_root(tmp_path)
    write_labels(root, hindered={0, 1, 2})
    assert not len(graspnet_frame_arrays(root, root.frame(frame_names()[0]))["cell"])


@pytest.mark.parametrize("prepare", [graspnet_frame_arrays, pointnetgpd_frame])
@pytest.mark.parametrize("count", [0, 3])
def test_collisions_of_other_grasp_labels_are_refused(tmp_path, prepare, count):
    """Both methods: the objects were labelled again, at more points."""
    root = write_root(tmp_path)
    write_labels(root)
    for scene in root.scenes():
        path = root.collision_label_path(scene.scene_id)
        labels = read_collision_labels(path)[:count]
        write_collision_labels(path, [each[:-1] for each in labels])
    with pytest.raises(FormatError, match="make both labels of the same points"):
        prepare(root, root.frame(frame_names()[0]))


def test_labelled_points_are_on_the_seen_surface(frame):
    cloud = frame["cloud"] / 10_000.0
    away = np.linalg.norm(frame["points"][:, None] - cloud, axis=-1).min(axis=1)
    assert 0 < len(away) < 3 * NUM_LABELLED
    assert away.max() < 0.01


def test_a_turned_cloud_has_the_labels_of_the_turned_views(frame):
    """A hand approaches, in the camera frame, against the view that the array names."""
    cloud = labelled_scene(frame, 2000, np.random.default_rng(0), turn=0.4)
    approach = cloud.turns[..., 0].numpy()
    named = -generate_views()[None]
    angle = np.degrees(np.arccos(np.clip((approach * named).sum(-1), -1, 1)))
    assert angle.max() < 15.0
    determinant = np.linalg.det(cloud.turns.numpy())
    assert_allclose(determinant, 1.0, atol=1e-4)


def test_grasp_values_are_logarithms_of_friction(frame):
    cloud = labelled_scene(frame, 500, np.random.default_rng(0), turn=0.0)
    assert_allclose(np.unique(cloud.value.numpy()), [0.0, np.log(2), np.log(5)], rtol=1e-6)


def test_tolerance_ends_where_too_few_neighbours_hold():
    side = np.arange(0.0, 0.1, 0.004)
    points = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    points = np.pad(points, ((0, 0), (0, 1))).astype(np.float32)
    assert len(points) > DENSE_POINTS
    holds = np.flatnonzero(points[:, 0] < 0.05).astype(np.int32)
    cell, friction = np.zeros(len(holds), np.int32), np.full(len(holds), 20, np.uint8)
    found = tolerances(points, holds, cell, friction)
    inner, rim = points[holds, 0] < 0.002, points[holds, 0] > 0.046
    assert found[inner].min() > 0.045
    assert found[rim].max() < 0.02


def test_sparse_labels_all_have_the_widest_tolerance():
    found = tolerances(np.zeros((5, 3), np.float32), np.arange(5), np.zeros(5), np.full(5, 90))
    assert_allclose(found, 0.05)


def test_frames_without_a_holding_grasp_are_refused(frame, tmp_path):
    nothing = frame | {name: frame[name][:0] for name in ("cell", "point", "friction")}
    path = tmp_path / "scene_0000.h5"
    write_peer_frames(path, [nothing], make_stamp("test", {}))
    with pytest.raises(ValueRangeError, match="--grasp-points"):
        GraspNetTraining(FrameSets([(path, 0)], [(path, 0)]), CONFIG, CPU, Processes())


def test_the_network_overfits_one_frame(frame, tmp_path):
    torch.manual_seed(0)
    path = tmp_path / "scene_0000.h5"
    write_peer_frames(path, [frame], make_stamp("test", {}))
    training = GraspNetTraining(FrameSets([(path, 0)], [(path, 0)]), CONFIG, CPU, Processes())
    cloud = labelled_scene(frame, 256, np.random.default_rng(0), 0.0)

    def loss():
        return mean_terms(training.module, [cloud], CPU)["total"]

    assert learned(training.module, loss, share=0.5, rate=3e-3, most_steps=8)
