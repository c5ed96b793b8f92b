"""Frames of a compared method are copied to a GPU and trained on as by `train-baseline`."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.configs import TrainBaselineConfig
from pipelines.learning.loop.runs import RunRequest
from pipelines.learning.peers import graspnet_clouds
from pipelines.learning.peers.graspnet_clouds import labelled_scene
from pipelines.learning.peers.graspnet_labels import graspnet_frame_arrays
from pipelines.learning.peers.peer import read_peer_frame, write_peer_frames
from pipelines.network.peers.graspnet import GRASPNET_SIZES, Sizes
from pipelines.storage.checkpoints import load_weights
from pipelines.storage.provenance import make_stamp, read_stamp
from tests.stages.toy_grasp_labels import write_labels
from tests.stages.toy_root import frame_names, write_root
from tools.gpu_training import graspnet_frames, scenes_on_device, train_peer

STAMP = make_stamp("train-baseline", {})


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    root = write_root(tmp_path_factory.mktemp("root"))
    write_labels(root)
    return [graspnet_frame_arrays(root, root.frame(name)) for name in frame_names()]


def same(one, other):
    assert set(one) == set(other)
    for name, array in one.items():
        assert array.dtype == other[name].dtype
        assert_array_equal(array, other[name])


def test_packed_frames_keep_their_labels_and_some_of_their_points(frames, tmp_path, monkeypatch):
    monkeypatch.setattr(graspnet_frames, "MOST_POINTS", 500)
    write_peer_frames(tmp_path / "before/scene_0000_toy.h5", frames, STAMP)
    packed = tmp_path / "packed.xz"
    assert graspnet_frames.pack_frames(packed, tmp_path / "before") == len(frames)
    assert packed.stat().st_size < 0.1 * (tmp_path / "before/scene_0000_toy.h5").stat().st_size
    assert graspnet_frames.unpack_frames(packed, tmp_path / "after") == len(frames)
    for row, before in enumerate(frames):
        after = read_peer_frame(tmp_path / "after/scene_0000_toy.h5", row)
        assert len(after["cloud"]) == len(after["on_object"]) == 500
        given = {
            tuple(point): seen
            for point, seen in zip(before["cloud"], before["on_object"], strict=True)
        }
        assert all(
            given[tuple(p)] == s for p, s in zip(after["cloud"], after["on_object"], strict=True)
        )
        points = {"cloud", "on_object"}
        same(
            {k: v for k, v in before.items() if k not in points},
            {k: v for k, v in after.items() if k not in points},
        )


def test_a_frame_with_all_its_points_comes_back_as_it_was(frames, monkeypatch):
    monkeypatch.setattr(graspnet_frames, "MOST_POINTS", 10**6)
    rng = np.random.default_rng(0)
    for before, after in zip(
        frames,
        graspnet_frames.unpacked_scene(graspnet_frames.packed_scene(frames, rng)),
        strict=True,
    ):
        same(before, after)


def test_a_cloud_on_the_device_has_the_labels_of_the_host(frames, monkeypatch):
    for module in (graspnet_clouds, scenes_on_device):
        monkeypatch.setattr(module, "MOST_LABELLED", 10**6)
    frame = frames[0]
    tensors = {name: torch.from_numpy(each) for name, each in frame.items()}
    count = len(frame["cloud"]) + 7  # some points occur twice
    host = labelled_scene(frame, count, np.random.default_rng(0), 0.4)
    device = scenes_on_device.scene_on_device(tensors, count, torch.Generator(), 0.4)
    for name in ("places", "turns", "value", "width", "tolerance"):
        assert_allclose(getattr(device, name), getattr(host, name), atol=1e-6)
    assert len(device.points) == count
    seen = [
        {tuple(p) for p in np.round(each.points[each.on_object].numpy(), 4)}
        for each in (host, device)
    ]
    assert len(seen[0] & seen[1]) > 0.98 * len(seen[0])  # except for rounding


def test_fewer_labelled_points_are_drawn_at_random(frames, monkeypatch):
    monkeypatch.setattr(scenes_on_device, "MOST_LABELLED", 5)
    tensors = {name: torch.from_numpy(each) for name, each in frames[0].items()}
    drawn = [
        scenes_on_device.scene_on_device(tensors, 100, torch.Generator().manual_seed(seed), 0.0)
        for seed in (0, 1)
    ]
    assert [len(each.places) for each in drawn] == [5, 5]
    assert not torch.equal(drawn[0].places, drawn[1].places)


def test_a_training_from_packed_frames_resumes_from_its_checkpoint(frames, tmp_path, monkeypatch):
    few = Sizes(512, (128, 64, 32, 16), (8, 8, 8, 8), 16)
    monkeypatch.setitem(GRASPNET_SIZES, "light", few)
    for scene in (0, 1):
        write_peer_frames(tmp_path / f"frames/scene_000{scene}_toy.h5", frames, STAMP)
    out = tmp_path / "graspnet.safetensors"
    config = TrainBaselineConfig(steps=2, epoch_steps=1, batch_size=1, max_val_frames=1)
    request = RunRequest(device="cpu", threads=1, resume=True)
    assert "2 steps" in train_peer.train_on_frames(
        "graspnet", tmp_path / "frames", out, config, request
    )
    assert load_weights(out)[0]
    assert list(read_stamp(out)["inputs"]) == ["frames"]
    assert "skipped" in train_peer.train_on_frames(
        "graspnet", tmp_path / "frames", out, config, request
    )
