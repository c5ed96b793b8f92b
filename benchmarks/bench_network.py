"""Times of the two networks relative to their arithmetic: one core, forward and training step.

The floor is the time of all operations at the rate of large matrix products, by torch's fastest
library. This rate is measured together with each figure, because other work on the machine slows
both.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from benchmarks.bench_infer import BUNDLED
from benchmarks.operations import gflop_of
from benchmarks.timing import Measurement, cpu_seconds_of
from pipelines.configs import DetectorConfig, NetworkConfig, TrainConfig
from pipelines.errors import SymgraspError
from pipelines.frames.frames import find_frames
from pipelines.inference import models
from pipelines.learning.grasp_network.grasp_training import Sample, sample_loss
from pipelines.network.cpu.products import linear
from pipelines.network.detection.detector import detector_image
from pipelines.network.detection.mask_rcnn import build_detector
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.training.losses import NUM_ERROR_POINTS
from pipelines.network.weights_files import read_weights
from pipelines.tabletop.depth_channels import height_plane
from tests.network.plain_network import PlainNetwork
from tests.network.toy_regions import toy_batch

NUM_REGIONS = 8
MICRO_BATCH = 6  # regions that a training step takes at once on a CPU
SIDE = 1024  # side of the matrices in the measured product
# Operations of a step relative to a forward pass: the backward pass has twice as many.
TRAINING_SHARE = 3.0


def measure() -> list[Measurement]:
    """Return seconds of one core, each with its floor and with the time of a plain version."""
    try:
        with models.one_thread_each():
            return [_forward(), _training_step(), *_detector()]
    except SymgraspError as error:
        return [Measurement("networks", None, "CPU-s", str(error))]


def _forward() -> Measurement:
    network = models.predictor(models.NETWORK_WEIGHTS, "cpu").network
    tensors, config = read_weights(models.NETWORK_WEIGHTS, SymmetryGraspNet.__name__, NetworkConfig)
    plain, points = PlainNetwork(tensors, config), toy_batch(NUM_REGIONS, config.num_points).points
    with torch.inference_mode():
        slow = cpu_seconds_of(lambda: plain(points), 1)
        name = f"network: {NUM_REGIONS} regions of {config.num_points} points"
        note = f"as the equations are written {slow:.2g} s"
        return _against_floor(name, lambda: network(points), 1.0, note)


def _training_step() -> Measurement:
    """Return forward, loss and backward of a micro-batch and its scaled copy."""
    config, network = TrainConfig(), SymmetryGraspNet(NetworkConfig())
    size = MICRO_BATCH
    truth = toy_batch(size, config.network.num_points)
    query = torch.rand(truth.points.shape[:2]).argsort(1)[:, : config.num_loss_points]
    copies = truth.mapped(1.1 * torch.eye(3).expand(size, 3, 3), torch.eye(3).expand(size, 3, 3))
    measured = torch.arange(NUM_ERROR_POINTS).expand(size, -1)
    sample = Sample(truth, copies, query, measured)

    def forward() -> Tensor:
        return sample_loss(network, sample, config, torch.device("cpu"))["total"]

    with torch.no_grad():
        alone = cpu_seconds_of(forward)
    note = f"forward alone {alone:.2g} s"
    name = f"network: training step, {size} regions and their copies"
    return _against_floor(name, lambda: forward().backward(), TRAINING_SHARE, note, counted=forward)


def _detector() -> list[Measurement]:
    """Return the times of the network alone, folded and plain, and of the whole `examine`."""
    detector, frame = (
        models.detector(models.DETECTOR_WEIGHTS, "cpu"),
        find_frames(BUNDLED)[0].read(),
    )
    tensors, config = read_weights(models.DETECTOR_WEIGHTS, "RegionDetector", DetectorConfig)
    plain = build_detector(config).eval()
    plain.load_state_dict(tensors)
    seen = frame.color, frame.depth, frame.intrinsics
    small = detector.resized(*seen)
    image = detector_image(small, height_plane(small), config.input)
    ready = image[None].to(memory_format=torch.channels_last)[0]
    with torch.inference_mode():
        slow = cpu_seconds_of(lambda: plain([image]))
        note = f"norms apart, channels first {slow:.2g} s"
        size = f"{image.shape[2]} x {image.shape[1]}"
        alone = _against_floor(
            f"detector: network at {size}", lambda: detector.model([ready]), 1.0, note
        )
    whole = cpu_seconds_of(lambda: detector.examine(*seen))
    found = detector.examine(*seen).detections
    note = f"with support plane, channels and masks; one core; {len(found)} regions"
    return [alone, Measurement("detector", whole, "CPU-s/frame", note)]


def _against_floor(
    name: str,
    step: Callable[[], object],
    share: float,
    note: str,
    counted: Callable[[], object] | None = None,
) -> Measurement:
    """Return the seconds of `step`, with their ratio to the seconds of its matrix products."""
    gflop = share * gflop_of(counted or step)
    before = _product_seconds()
    seconds = cpu_seconds_of(step, 5)
    rate = 2.0 * SIDE**3 / 1e9 / (0.5 * (before + _product_seconds()))
    floor = f"{seconds * rate / gflop:.2f} times the floor, {gflop:.2f} GFLOP at {rate:.0f}/s"
    return Measurement(name, seconds, "CPU-s", f"{floor}; {note}; one core")


@torch.no_grad()
def _product_seconds() -> float:
    """Return the seconds of one large product of matrices."""
    a, b = torch.rand(2, SIDE, SIDE)
    return min(cpu_seconds_of(lambda: a @ b, 5), cpu_seconds_of(lambda: linear(a, b), 5))
