"""Whole trainings and predictors on a pretended GPU: no tensor is left on the CPU."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pipelines import finetune_detector, train
from pipelines.configs import DetectorConfig, FinetuneDetectorConfig
from pipelines.dataset.training import detector_frames
from pipelines.dataset.training.packed_regions import PackedReader
from pipelines.dataset.training.region_frames import split_frames
from pipelines.errors import SymgraspError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.health import torch_checks
from pipelines.health.checks import Status
from pipelines.inference.models import DETECTOR_WEIGHTS, NETWORK_WEIGHTS
from pipelines.learning.detector.detector_start import starting_detector
from pipelines.learning.detector.detector_training import DetectorTraining
from pipelines.learning.grasp_network.grasp_training import GraspTraining
from pipelines.learning.grasp_network.region_sources import RegionSet, TrainingRegions, packed_items
from pipelines.learning.loop.runs import FAULT, RunRequest, file_of_run
from pipelines.learning.speed.gradients import GradientWorkers
from pipelines.learning.speed.micro_batches import micro_batches_of
from pipelines.learning.speed.processes import Processes
from pipelines.network.detection.detector import RegionDetector
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.predictor import GraspPredictor
from pipelines.runtime.batch import BatchOptions
from tests.learning.packed_toys import CONFIG, write_packed
from tests.learning.pretended_gpu import pretended_gpu
from tests.learning.stopped import stopped_after
from tests.stages.toy_root import write_root

REQUEST = RunRequest(device="cuda", threads=2)
SMALL = replace(CONFIG, epochs=1, batch_size=4, micro_batch_size=2)
TABLE = Plane(np.array([0.0, -0.6, -0.8]), 0.7)


def refused():
    there, here = torch.ones(3, device="cuda"), torch.arange(3)
    generator = torch.Generator()
    return {
        "a sum": lambda: there + here,
        "a part by index": lambda: here[there.long()],
        "a join": lambda: torch.stack([there.sum(), here.sum()]),
        "an array": there.numpy,
        "NumPy's array": lambda: np.asarray(there),
        "an order": lambda: torch.randperm(3, generator=generator, device="cuda"),
        "a draw": lambda: torch.empty_like(there).bernoulli_(generator=generator),
        "a running sum": lambda: torch._foreach_add_([here.float()], [there]),
    }


def test_operations_that_a_gpu_refuses_raise_an_error():
    with pretended_gpu():
        for name, call in refused().items():
            with pytest.raises((RuntimeError, TypeError)):
                pytest.fail(f"{name} was taken: {call()}")


def test_operations_that_a_gpu_allows_pass():
    with pretended_gpu():
        there = torch.ones(3, device="cuda", requires_grad=True)
        sums = (there + torch.tensor(1.0))[torch.tensor([0, 2])].sum()
        sums.backward()
        assert sums.device == there.grad.device == torch.device("cuda", 0)
        assert there.grad.cpu().numpy().tolist() == [1.0, 0.0, 1.0]


@pytest.mark.slow
def test_a_network_is_trained_validated_saved_and_resumed(tmp_path):
    packed, path = write_packed(tmp_path, 2, 8), tmp_path / "network.safetensors"
    with pretended_gpu():
        with stopped_after(1):
            train.run(packed, None, path, SMALL, REQUEST)
        report = train.run(packed, None, path, SMALL, replace(REQUEST, resume=True))
    assert report.notes[path.name].startswith("2 steps")
    assert "plane_angle_deg" in report.notes[path.name]


def test_a_step_of_the_network_stays_on_the_gpu(tmp_path):
    reader = PackedReader(write_packed(tmp_path, 1, 4))
    regions = RegionSet(reader, np.arange(len(reader)))
    with pretended_gpu():
        source, network = TrainingRegions(regions, None, SMALL), SymmetryGraspNet(SMALL.network)
        trainee = GraspTraining(network, source, regions, SMALL, torch.device("cuda"))
        assert_gradients_are_there(trainee, packed_items(np.arange(2)))


@pytest.mark.slow
def test_a_network_that_diverges_saves_its_batch(tmp_path):
    packed, path = write_packed(tmp_path, 2, 4), tmp_path / "network.safetensors"
    wild = replace(SMALL, batch_size=2, learning_rate=1e30)
    with pretended_gpu(), pytest.raises(SymgraspError, match="holds the batch"):
        train.run(packed, None, path, wild, REQUEST)
    assert not np.isfinite(train.replay(file_of_run(path, FAULT))["total"])


def assert_gradients_are_there(trainee, items):
    """Take the losses of one batch and their gradients on the pretended GPU."""
    (piece,) = micro_batches_of(items, len(items), Processes())
    trainee.module.train()
    loaded = [(piece, piece.load(trainee, 0, 0, 0))]
    with GradientWorkers(trainee, 1) as workers:
        losses, gradients = workers.gradients(loaded, (0, 0, 0))
    assert np.isfinite(losses["total"])
    assert {each.device.type for each in gradients} == {"cuda"}


def detector_config(variant):
    small = DetectorConfig(min_size=96, max_size=128, min_confidence=0.0, variant=variant)
    return FinetuneDetectorConfig(
        detector=small, epochs=2, batch_size=2, micro_batch_size=1, min_pixels=50
    )


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    return write_root(tmp_path_factory.mktemp("root")).root


@pytest.mark.slow
def test_a_detector_is_trained_validated_saved_and_resumed(root, tmp_path):
    path, config = tmp_path / "detector.safetensors", detector_config("light")
    quiet = BatchOptions(progress=False)
    with pretended_gpu():
        with stopped_after(1):
            finetune_detector.run([root], path, config, REQUEST, split=None, options=quiet)
        resumed = replace(REQUEST, resume=True)
        report = finetune_detector.run([root], path, config, resumed, split=None, options=quiet)
    assert report.notes[path.name].startswith("2 steps")
    assert "mask_ap50" in report.notes[path.name]


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["light", "resnet50"])
def test_a_step_of_the_detector_stays_on_the_gpu(root, tmp_path, variant):
    path, config = tmp_path / "detector.safetensors", detector_config(variant)
    items = finetune_detector.scene_items(root, path, config)
    finetune_detector.prepare(root, items, config, BatchOptions(progress=False))
    files = sorted(finetune_detector.frames_folder(path, root).glob("*.h5"))
    frames = split_frames(files, detector_frames.count_frames, config.val_fraction, 0)
    with pretended_gpu():
        detector = starting_detector(config, 0)
        trainee = DetectorTraining(detector, frames, config, torch.device("cuda"))
        assert_gradients_are_there(trainee, np.arange(1))


def test_the_predictor_gives_the_same_predictions_with_mirror_images():
    rng = np.random.default_rng(0)
    clouds = [rng.normal((0.0, 0.0, 0.6), 0.03, (count, 3)) for count in (400, 2000)]
    with pretended_gpu():
        there = GraspPredictor.load(NETWORK_WEIGHTS, "cuda", True).predict(clouds, TABLE)
    here = GraspPredictor.load(NETWORK_WEIGHTS, "cpu", True).predict(clouds, TABLE)
    for one, other in zip(there, here, strict=True):
        for name, expected in vars(other).items():
            np.testing.assert_allclose(getattr(one, name), expected, atol=1e-4)


def test_the_detector_finds_the_same_regions():
    rng, lens = np.random.default_rng(0), Intrinsics(120.0, 120.0, 63.5, 47.5, 128, 96)
    color = rng.integers(0, 255, (96, 128, 3)).astype(np.uint8)
    depth = np.full((96, 128), 0.8, np.float32)
    depth[30:60, 40:80] = 0.7
    with pretended_gpu():
        there = RegionDetector.load(DETECTOR_WEIGHTS, "cuda").examine(color, depth, lens).detections
    here = RegionDetector.load(DETECTOR_WEIGHTS, "cpu").examine(color, depth, lens).detections
    assert [each.confidence for each in there] == pytest.approx([each.confidence for each in here])


def test_the_checks_of_doctor_pass():
    with pretended_gpu():
        assert torch_checks.operator_check("cuda:0").status is Status.OK
        assert torch_checks.product_error("cuda:0") < 1e-5
