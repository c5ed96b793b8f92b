"""PointNetGPD's labelled hands of a frame, and a training that overfits them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pipelines.configs import TrainBaselineConfig
from pipelines.dataset.training.region_frames import FrameSets
from pipelines.errors import ValueRangeError
from pipelines.learning.peers import pointnetgpd_training
from pipelines.learning.peers.peer import write_peer_frames
from pipelines.learning.peers.pointnetgpd_labels import BAD, FAIR, GOOD, labelled_hands
from pipelines.learning.peers.pointnetgpd_training import (
    HANDS_A_FRAME,
    PointNetGPDTraining,
    class_loss,
    drawn_crops,
    pointnetgpd_frame,
)
from pipelines.learning.speed.processes import Processes
from pipelines.network.peers.pointnetgpd import PointNetGPD
from pipelines.storage.provenance import make_stamp
from tests.learning.by_heart import learned
from tests.stages.toy_grasp_labels import write_labels
from tests.stages.toy_root import frame_names, write_root

CONFIG = TrainBaselineConfig().with_schedule(PointNetGPDTraining.peer.schedule)
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = write_root(tmp_path_factory.mktemp("root"))
    write_labels(root)
    return root


@pytest.fixture(scope="module")
def frame(root):
    return pointnetgpd_frame(root, root.frame(frame_names()[0]))


def test_hands_have_the_class_of_their_objects_label(root):
    found = labelled_hands(root, root.frame(frame_names()[0]))
    assert set(found.kind.tolist()) == {BAD, FAIR, GOOD}
    outward = -found.hands.rotation[:, :, 0]
    toward_camera = -found.hands.origin / np.linalg.norm(found.hands.origin, axis=1)[:, None]
    assert (np.einsum("ni,ni->n", outward, toward_camera) > 0).mean() > 0.9


def test_colliding_hands_are_no_examples(tmp_path):
    root = write_root(tmp_path)
    write_labels(root, hindered={0})
    assert GOOD not in labelled_hands(root, root.frame(frame_names()[0])).kind


def test_points_too_far_to_be_stored_do_not_come_near(root, frame, monkeypatch):
    found = labelled_hands(root, root.frame(frame_names()[0]))
    far = np.array([[0.5, 0.2, 5.0], [4.0, 0.0, 1.0]])
    both = replace(found, objects=np.concatenate([found.objects, far]))
    monkeypatch.setattr(pointnetgpd_training, "labelled_hands", lambda *_: both)
    again = pointnetgpd_frame(root, root.frame(frame_names()[0]))
    np.testing.assert_array_equal(again["objects"], frame["objects"])


def test_half_of_the_drawn_hands_are_good_and_each_closes_on_enough_points(frame):
    crops = drawn_crops(frame, 256, np.random.default_rng(0))
    assert crops.points.shape == (HANDS_A_FRAME, 256, 3)
    assert int((crops.kind == GOOD).sum()) == HANDS_A_FRAME // 2
    assert float(crops.points.abs().amax()) < 0.05


def test_crops_depend_only_on_their_generator(frame):
    first, again = (drawn_crops(frame, 64, np.random.default_rng(5)) for _ in range(2))
    torch.testing.assert_close(first.points, again.points)


def test_frames_without_labelled_hands_are_left_out_and_no_frames_are_an_error(frame, tmp_path):
    empty = frame | {"kind": frame["kind"][:0]}
    path = tmp_path / "scene_0000.h5"
    write_peer_frames(path, [frame, empty], make_stamp("test", {}))
    both, second = [(path, 0), (path, 1)], [(path, 1)]
    training = PointNetGPDTraining(FrameSets(both, both), CONFIG, CPU, Processes())
    assert training.frames.train == [(path, 0)]
    with pytest.raises(ValueRangeError, match="--grasp-points"):
        PointNetGPDTraining(FrameSets(both, second), CONFIG, CPU, Processes())


def test_the_network_overfits_some_hands(frame):
    torch.manual_seed(0)
    network = PointNetGPD(CONFIG.network)
    crops = drawn_crops(frame, 64, np.random.default_rng(0))

    def loss():
        return class_loss(network, crops, CPU)[0]

    assert learned(network, loss, share=0.1, rate=1e-3, most_steps=25)
