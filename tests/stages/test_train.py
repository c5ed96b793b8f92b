"""The train stage: weights that load, what is skipped, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pipelines import train
from pipelines.errors import FormatError, SymgraspError
from pipelines.formats import object_list
from pipelines.formats.checkpoints import load_weights, save_weights
from pipelines.formats.object_list import ObjectRecord
from pipelines.learning.runs import RunRequest
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.predictor import GraspPredictor
from pipelines.network.weights_files import weights_metadata
from tests.learning.packed_toys import CONFIG, write_packed
from tests.stages.toy_root import STAMP, write_root
from tests.synthesis.test_endless import CONFIG as ENDLESS

REQUEST = RunRequest(device="cpu", threads=1)


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    return write_packed(tmp_path_factory.mktemp("packed"))


@pytest.fixture(scope="module")
def output(packed, tmp_path_factory):
    path = tmp_path_factory.mktemp("out") / "network.safetensors"
    train.run(packed, None, path, CONFIG, REQUEST)
    return path


def test_the_weights_load_into_the_predictor(output):
    region = np.random.default_rng(0).normal((0.0, 0.0, 0.6), 0.03, (300, 3))
    (prediction,) = GraspPredictor.load(output, "cpu").predict([region])
    assert np.isfinite(prediction.center).all()


def test_a_finished_training_is_skipped(packed, output):
    before = output.stat().st_mtime_ns
    report = train.run(packed, None, output, CONFIG, REQUEST)
    assert report.skipped == ["network.safetensors"]
    assert output.stat().st_mtime_ns == before


def test_other_settings_are_refused(packed, output):
    with pytest.raises(SymgraspError, match="another config"):
        train.run(packed, None, output, replace(CONFIG, learning_rate=0.1), REQUEST)


def test_a_resumed_training_equals_one_that_never_stopped(packed, output, tmp_path):
    path = tmp_path / "network.safetensors"
    limited = replace(REQUEST, time_limit=0.0)  # stops before its first step
    train.run(packed, None, path, CONFIG, limited)
    assert not path.exists()
    train.run(packed, None, path, CONFIG, replace(REQUEST, resume=True))
    assert path.read_bytes() == output.read_bytes()


def test_a_folder_of_its_own_can_be_validated_on(packed, tmp_path):
    other = write_packed(tmp_path / "val", 1)
    path = tmp_path / "network.safetensors"
    report = train.run(packed, other, path, replace(CONFIG, epochs=1), REQUEST)
    assert "plane_angle_deg" in report.notes["network.safetensors"]


def test_endless_regions_beside_packed_ones_resume_to_the_byte(packed, tmp_path):
    root = write_root(tmp_path / "root").root
    records = [ObjectRecord(i, f"object{i}", "toy", "seen") for i in range(3)]
    object_list.write(root / "objects.json", records, STAMP)
    config = replace(CONFIG, epochs=1, endless=replace(ENDLESS, share=0.5))
    outputs = [tmp_path / name / "network.safetensors" for name in ("whole", "halves")]
    train.run(packed, None, outputs[0], config, REQUEST, endless=root)
    limited = replace(REQUEST, time_limit=0.0)
    train.run(packed, None, outputs[1], config, limited, endless=root)
    resumed = replace(REQUEST, resume=True)
    train.run(packed, None, outputs[1], config, resumed, endless=root)
    assert outputs[0].read_bytes() == outputs[1].read_bytes()


def test_training_on_nothing_but_fresh_regions_needs_something_to_judge_by(tmp_path):
    with pytest.raises(SymgraspError, match="needs --val"):
        train.run(None, None, tmp_path / "x.safetensors", CONFIG, REQUEST)


def weights_of(path, network):
    torch.manual_seed(1)
    metadata = weights_metadata("SymmetryGraspNet", network)
    save_weights(path, SymmetryGraspNet(network).state_dict(), metadata)
    return path


def test_a_network_starts_from_the_weights_that_are_given(tmp_path):
    path = weights_of(tmp_path / "w.safetensors", CONFIG.network)
    start = train.build(CONFIG, 0, None).state_dict()
    found, expected = train.build(CONFIG, 0, path).state_dict(), load_weights(path)[0]
    assert all(torch.equal(found[name], expected[name]) for name in found)
    assert not all(torch.equal(found[name], start[name]) for name in found)


def test_weights_of_a_network_with_other_settings_are_no_start(tmp_path):
    told = replace(CONFIG.network, canonical_frame=False)
    path = weights_of(tmp_path / "w.safetensors", told)
    expected = r"with canonical_frame=False; canonical_frame=True is asked for"
    with pytest.raises(FormatError, match=expected):
        train.build(CONFIG, 0, path)
    train.build(replace(CONFIG, network=told), 0, path)
