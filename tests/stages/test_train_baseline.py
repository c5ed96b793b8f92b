"""The train-baseline stage on a toy dataset: labels, resumed runs, and weights that find grasps."""

import shutil
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest
import torch

from pipelines import infer, train_baseline
from pipelines.configs import InferConfig, TrainBaselineConfig
from pipelines.configs.inference import TRAINED_METHODS
from pipelines.configs.peers import PeerNetworkConfig
from pipelines.dataset.graspnet.graspnet_labels import read_rect, write_rect
from pipelines.dataset.training.region_frames import split_frames
from pipelines.errors import MissingInputError, UnknownNameError, ValueRangeError
from pipelines.grasp_files.grasps_stream import read_index, read_results
from pipelines.inference.peers.pointnetgpd import AT_ONCE, MOST_SCORED
from pipelines.learning.loop.faults import save_fault
from pipelines.learning.loop.runs import RunRequest
from pipelines.learning.peers.peer import count_peer_frames
from pipelines.learning.peers.registry import TRAINED_PEERS, trained_peer
from pipelines.learning.speed.gradients import loss_seed
from pipelines.learning.speed.processes import Processes
from pipelines.network.peers.graspnet import GRASPNET_SIZES, Sizes
from pipelines.network.peers.multi_grasp import LONG_SIDES, SHORT_SIDES
from pipelines.network.peers.trained import PEER_NETWORKS
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.checkpoints import load_weights
from pipelines.storage.provenance import make_stamp
from tests.learning.stopped import stopped_after
from tests.stages.toy_grasp_labels import write_labels, write_rects
from tests.stages.toy_root import frame_names, write_root

CONFIG = TrainBaselineConfig(steps=2, epoch_steps=2, batch_size=2, micro_batch_size=1)
REQUEST = RunRequest(device="cpu", threads=1)
QUIET = BatchOptions(progress=False)


@pytest.fixture(scope="module", autouse=True)
def small_networks():
    """Let the networks see a few of their points, pixels and hands: the toys are few and small."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(GRASPNET_SIZES, "light", Sizes(1024, (256, 128, 64, 32), (8, 8, 8, 8), 16))
        patch.setitem(SHORT_SIDES, "light", 96)
        patch.setitem(LONG_SIDES, "light", 128)
        patch.setitem(MOST_SCORED, "light", AT_ONCE + 16)
        yield


@pytest.fixture(scope="module")
def bare_root(tmp_path_factory):
    return write_root(tmp_path_factory.mktemp("bare"))


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = write_root(tmp_path_factory.mktemp("root"))
    write_rects(root)
    write_labels(root)
    return root


def train(root, path, config=CONFIG, request=REQUEST, name="gg-cnn"):
    return train_baseline.run(name, root.root, path, config, request, split=None, options=QUIET)


@pytest.fixture(scope="module")
def trained(root, tmp_path_factory):
    """Return the weights of each method, trained once."""
    folder = tmp_path_factory.mktemp("out")

    @cache
    def of(name):
        path = folder / f"{name}.safetensors"
        assert train(root, path, name=name).done
        return path

    return of


def test_a_root_without_rectangles_is_refused_with_the_option_that_makes_them(bare_root, tmp_path):
    with pytest.raises(MissingInputError, match=r"rect does not exist; .*--collision-labels"):
        train(bare_root, tmp_path / "w.safetensors")


def test_a_frame_without_depth_is_named_and_not_left_out(tmp_path):
    root = write_root(tmp_path / "root")
    write_rects(root)
    lost = root.frame(frame_names()[0]).path("depth")
    lost.unlink()
    (sentence,) = train(root, tmp_path / "w.safetensors").failed.values()
    assert str(lost) in sentence


def test_an_unknown_method_is_refused(root, tmp_path):
    with pytest.raises(UnknownNameError, match="gg-cnn"):
        train(root, tmp_path / "w.safetensors", name="gg-nn")


@pytest.mark.parametrize("name", ["gg-cnn", "multi-grasp"])
def test_a_root_whose_rectangles_are_all_hidden_is_refused(name, tmp_path):
    root = write_root(tmp_path / "root")
    write_rects(root)
    for frame in frame_names():
        path = root.frame(frame).path("rect")
        write_rect(path, read_rect(path)[-1:])
    with pytest.raises(ValueRangeError, match=r"labelled grasp is 0; .*--grasp-points 400"):
        train(root, tmp_path / "w.safetensors", name=name)


def test_rectangles_of_hidden_objects_are_no_labels(root):
    from pipelines.learning.peers.ggcnn_training import ggcnn_frame

    frame = ggcnn_frame(root, root.frame(frame_names()[0]), PeerNetworkConfig())
    assert sorted(set(frame["rows"][:, 6].tolist())) == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(("name", "largest"), [("gg-cnn", 0.4), ("multi-grasp", 0.2)])
def test_rectangles_up_to_the_largest_friction_are_labels(name, largest, tmp_path):
    root = write_root(tmp_path / "root")
    write_rects(root)
    files, friction = root.frame(frame_names()[0]), np.arange(1, 11) / 10
    rows = np.repeat(read_rect(files.path("rect"))[:1], len(friction), axis=0)
    rows[:, 0] += np.arange(len(friction)) / 10  # different places
    rows[:, 5] = 1.1 - friction
    write_rect(files.path("rect"), rows)
    kept = trained_peer(name).peer.prepare(root, files, PeerNetworkConfig())["rows"]
    assert sorted(np.round(1.1 - kept[:, 5], 3)) == friction[friction <= largest].tolist()


def test_a_finished_training_is_skipped(root, trained):
    assert train(root, trained("gg-cnn")).skipped == ["gg-cnn.safetensors"]


@pytest.mark.parametrize("name", TRAINED_PEERS)
def test_a_resumed_training_equals_one_that_never_stopped(name, root, trained, tmp_path):
    whole = trained(name)
    path = tmp_path / whole.name
    with stopped_after(1):
        report = train(root, path, name=name)
    assert report.notes[path.name].startswith("1 step in ")
    assert train(root, path, request=replace(REQUEST, resume=True), name=name).done
    assert path.read_bytes() == whole.read_bytes()


def test_damaged_frames_are_prepared_again(root, trained, tmp_path):
    copy = tmp_path / "gg-cnn.safetensors"
    shutil.copytree(trained("gg-cnn").with_suffix(".frames"), copy.with_suffix(".frames"))
    damaged = next(copy.with_suffix(".frames").glob("*.h5"))
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[:-100])
    assert train(root, copy).done
    assert damaged.read_bytes() == whole


def test_processes_that_load_batches_change_nothing(root, trained, tmp_path):
    path = tmp_path / "gg-cnn.safetensors"
    assert train(root, path, request=replace(REQUEST, loaders=2)).done
    assert path.read_bytes() == trained("gg-cnn").read_bytes()


def test_a_method_without_weights_is_refused_with_the_command_that_writes_them(root, tmp_path):
    paths = infer.InferPaths(root.root, tmp_path / "grasps.h5")
    with pytest.raises(ValueRangeError, match=r"--weights .*symgrasp train-baseline gg-cnn"):
        infer.run(paths, InferConfig(method="gg-cnn"), QUIET)


@pytest.mark.parametrize("name", TRAINED_METHODS)
def test_infer_uses_the_weights(name, root, trained, tmp_path):
    out = tmp_path / "grasps.h5"
    paths = infer.InferPaths(root.root / "scenes" / "scene_0100", out, peer=trained(name))
    config = InferConfig(method=name, regions="geometric")
    report = infer.run(paths, config, QUIET)
    assert not report.failed
    assert "peer" in read_index(out).stamp["inputs"]
    found = list(read_results(out, range(len(report.done))))
    assert found
    assert {result.status for result in found} <= {"ok", "empty"}


@pytest.mark.parametrize("name", TRAINED_PEERS)
def test_a_saved_batch_gives_the_same_loss_again(name, root, trained, tmp_path):
    tensors, metadata = load_weights(trained(name))
    items = train_baseline.peer_items(name, root.root, trained(name), CONFIG)
    peer, config = trained_peer(name), CONFIG.with_schedule(trained_peer(name).peer.schedule)
    frames = split_frames([item.target for item in items], count_peer_frames, 0.1, 0)
    trainee = peer(frames, config, torch.device("cpu"), Processes())
    trainee.module.load_state_dict(tensors)
    trainee.module.train()
    batch = trainee.load(np.array([0]), [np.random.default_rng(0)])
    place = (0, 1, 2, 0)
    expected = trainee.loss(trainee.module, batch, torch.Generator().manual_seed(loss_seed(*place)))
    path = tmp_path / "w.fault.safetensors"
    stamp = make_stamp("train-baseline", {"method": name, **asdict(config)})
    trainee.module.load_state_dict(tensors)
    save_fault(path, trainee.module, trainee.tensors(batch), place, stamp)
    again = train_baseline.replay(path)
    assert again == pytest.approx({n: float(t.detach()) for n, t in expected.items()}, rel=1e-5)
    assert metadata["model"] == PEER_NETWORKS[name][0]
