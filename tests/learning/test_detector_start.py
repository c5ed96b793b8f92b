"""What a detector starts from: drawn from a seed, or given; what is not its own is refused."""

from dataclasses import replace

import pytest
import torch

from pipelines.configs import DetectorConfig, FinetuneDetectorConfig
from pipelines.errors import FormatError, UnknownNameError, ValueRangeError
from pipelines.formats.checkpoints import save_weights
from pipelines.learning.detector_start import read_coco, starting_detector
from pipelines.network.detector import MODEL_NAME
from pipelines.network.weights_files import weights_metadata

CONFIG = FinetuneDetectorConfig()


def test_a_seed_draws_the_same_detector_and_leaves_torchs_generator_alone():
    before = torch.get_rng_state()
    first, again, other = (starting_detector(CONFIG, seed).state_dict() for seed in (3, 3, 4))
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not all(torch.equal(first[name], other[name]) for name in first)
    assert torch.equal(torch.get_rng_state(), before)


def test_given_weights_are_taken_whole(tmp_path):
    path = tmp_path / "detector.safetensors"
    given = starting_detector(CONFIG, 5).state_dict()
    save_weights(path, given, weights_metadata(MODEL_NAME, CONFIG.detector))
    found = starting_detector(CONFIG, 6, init=path).state_dict()
    assert all(torch.equal(found[name], given[name]) for name in given)


def test_coco_weights_are_for_resnet50_only():
    with pytest.raises(ValueRangeError, match="resnet50"):
        starting_detector(CONFIG, 0, "weights.pth")


def test_weights_that_run_code_are_refused(tmp_path):
    path = tmp_path / "coco.pth"
    path.write_bytes(b"\x80\x02cos\nsystem\n.")
    with pytest.raises(FormatError, match="cannot be read as weights"):
        read_coco(str(path))


def test_an_unknown_variant_names_the_known_ones():
    config = replace(CONFIG, detector=DetectorConfig(variant="yolo"))
    with pytest.raises(UnknownNameError, match="light, resnet50"):
        starting_detector(config, 0)
