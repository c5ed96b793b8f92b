"""SymmetryNet's regions with their truth, and a training that overfits them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from pipelines.configs import TrainBaselineConfig
from pipelines.configs.peers import PeerNetworkConfig
from pipelines.dataset.training.region_frames import FrameSets
from pipelines.errors import MissingInputError, ValueRangeError
from pipelines.learning.peers import peer, symmetrynet_training
from pipelines.learning.peers.peer import refuse_lacking, write_peer_frames
from pipelines.learning.peers.symmetrynet_regions import (
    covered,
    drawn_region,
    plain_region,
    restored,
    stacked_regions,
    stored,
    symmetrynet_frame,
)
from pipelines.learning.peers.symmetrynet_training import (
    SymmetryNetTraining,
    symmetry_terms,
    true_modes,
)
from pipelines.learning.speed.processes import Processes
from pipelines.network.peers.symmetrynet import SymmetryNet, SymmetryOutput
from pipelines.storage.provenance import make_stamp
from tests.learning.by_heart import learned
from tests.stages.toy_root import frame_names, poses_in_camera, write_root

CONFIG = TrainBaselineConfig().with_schedule(SymmetryNetTraining.peer.schedule)
CPU = torch.device("cpu")
BOX, CAN, BALL = range(3)  # rows of `regions`


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return write_root(tmp_path_factory.mktemp("root"))


@pytest.fixture(scope="module")
def arrays(root):
    return symmetrynet_frame(root, root.frame(frame_names()[0]))


@pytest.fixture(scope="module")
def regions(arrays):
    """Return the box, the can and the ball."""
    return sorted(restored(arrays), key=lambda each: -each.existence[:3].sum())


def test_regions_have_their_objects_symmetries_in_the_cameras_frame(regions):
    pose = poses_in_camera(0)
    assert [each.existence.tolist() for each in regions] == [
        [1, 1, 1, 0, 0],
        [1, 0, 0, 1, 0],
        [0, 0, 0, 0, 1],
    ]
    assert_allclose(regions[BALL].place[4], pose[2][:3, 3], atol=1e-5)
    assert_allclose(regions[CAN].direction[3], pose[1][:3, 2], atol=1e-5)
    from_center = np.linalg.norm(regions[BALL].points - pose[2][:3, 3], axis=1)
    assert np.median(from_center) == pytest.approx(0.03, abs=0.002)


def test_regions_too_far_to_be_stored_are_left_out(root, monkeypatch):
    monkeypatch.setattr(peer, "STORABLE", 0.3)
    assert not len(symmetrynet_frame(root, root.frame(frame_names()[0]))["existence"])


def test_a_prepared_region_takes_few_bytes(arrays):
    assert sum(each.nbytes for each in arrays.values()) < 30_000 * len(arrays["existence"])


def test_a_root_without_symmetries_is_refused_with_the_command_that_finds_them(root, tmp_path):
    bare = type(root)(tmp_path)
    with pytest.raises(MissingInputError, match="symgrasp annotate-symmetry"):
        refuse_lacking(bare, [], SymmetryNetTraining.peer.needs)


def test_frames_without_a_region_are_refused(tmp_path):
    path = tmp_path / "scene_0000.h5"
    write_peer_frames(path, [stored([])], make_stamp("test", {}))
    with pytest.raises(ValueRangeError, match="number of regions"):
        SymmetryNetTraining(FrameSets([(path, 0)], [(path, 0)]), CONFIG, CPU, Processes())


def test_frames_without_a_region_are_not_validated_on(arrays, tmp_path):
    path = tmp_path / "scene_0000.h5"
    write_peer_frames(path, [stored([]), arrays], make_stamp("test", {}))
    frames, config = (
        FrameSets([(path, 1)], [(path, 0), (path, 1)]),
        replace(CONFIG, max_val_frames=1),
    )
    trainee = SymmetryNetTraining(frames, config, CPU, Processes())
    trainee.module.eval()
    assert np.isfinite(trainee.validate()["loss"])


def true_output(seen):
    """Return the `SymmetryOutput` of a batch whose points predict the truth."""
    points, normal = seen.points[:, :, None], seen.direction[:, None]
    across = ((points - seen.place[:, None]) * normal).sum(-1, keepdim=True) * normal
    feet = -across[:, :, :3]
    on_axis = seen.place[:, None, 3] - seen.points
    along = seen.direction[:, None, 3]
    foot = on_axis - (on_axis * along).sum(-1, keepdim=True) * along
    count = seen.existence.sum(1)[:, None, None]
    center = seen.place.sum(1)[:, None] / count - seen.points
    exists = seen.existence[:, None, :3].expand(-1, points.shape[1], -1)
    mode = torch.nn.functional.one_hot(true_modes(seen.existence > 0), 4) * 50.0
    mode = mode[:, None].expand(-1, points.shape[1], -1)
    return SymmetryOutput(center, 2 * feet, feet, foot, exists, mode)


@pytest.mark.parametrize("is_noisy", [False, True])
def test_points_that_predict_the_truth_have_no_loss(regions, is_noisy):
    rng = np.random.default_rng(0)
    drawn = (
        [drawn_region(each, regions[:2], 300, rng) for each in regions]
        if is_noisy
        else [plain_region(each, 300) for each in regions]
    )
    seen = stacked_regions(drawn)
    terms = symmetry_terms(lambda *_: true_output(seen), seen, CPU)
    assert float(terms["total"]) < 0.02


def test_planes_may_be_predicted_in_any_order(regions):
    seen = stacked_regions([plain_region(regions[BOX], 300)])
    known, order = true_output(seen), [2, 0, 1]
    turned = SymmetryOutput(
        known.center,
        known.mirrored[:, :, order],
        known.feet[:, :, order],
        known.axis_foot,
        known.existence[..., order],
        known.mode,
    )
    assert float(symmetry_terms(lambda *_: turned, seen, CPU)["total"]) < 0.01


def test_modes_are_planes_axis_both_and_sphere():
    exists = np.array([[1, 1, 0, 0, 0], [0, 0, 0, 1, 0], [1, 0, 0, 1, 0], [0, 0, 0, 0, 1]])
    assert true_modes(torch.from_numpy(exists) > 0).tolist() == [0, 1, 2, 3]


def test_a_pasted_instance_takes_the_points_under_it(regions):
    rng = np.random.default_rng(3)
    counts = [len(covered(regions[BOX], regions[CAN], rng).points) for _ in range(30)]
    whole = len(regions[BOX].points)
    assert min(counts) < whole
    assert min(counts) >= 0.5 * whole


def test_each_region_has_the_same_weight_in_the_validation(arrays, regions, tmp_path, monkeypatch):
    path = tmp_path / "scene_0000.h5"
    write_peer_frames(path, [arrays], make_stamp("test", {}))
    torch.manual_seed(0)
    trainee = SymmetryNetTraining(FrameSets([(path, 0)], [(path, 0)]), CONFIG, CPU, Processes())
    trainee.module.eval()
    losses = []
    for together in (len(regions) - 1, 1):  # the last batch has one region
        monkeypatch.setattr(symmetrynet_training, "JUDGED_TOGETHER", together)
        losses.append(trainee.validate()["loss"])
    assert losses[0] == pytest.approx(losses[1], rel=1e-4)


def test_the_network_overfits_one_batch(regions):
    torch.manual_seed(0)
    network = SymmetryNet(PeerNetworkConfig())
    seen = stacked_regions([plain_region(each, 40) for each in regions])

    def loss():
        return symmetry_terms(network, seen, CPU)["total"]

    assert learned(network, loss, share=0.2, rate=4e-3, most_steps=100)
