"""`infer` on the bundled frames: seconds a frame, by step."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

import pipelines
from benchmarks.timing import Measurement
from pipelines.configs import InferConfig
from pipelines.errors import SymgraspError
from pipelines.formats.frames import find_frames
from pipelines.formats.gripper_files import load_gripper
from pipelines.formats.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.inference import models
from pipelines.inference.frame_grasps import Planner, Predictor, RegionPrediction
from pipelines.inference.regions import Detection, Detector

FRAMES = Path(pipelines.__file__).parent / "weights" / "frames"


@dataclass
class TimedDetector:
    """A detector that adds up the seconds it takes."""

    detector: Detector
    seconds: float = 0.0

    def detect(
        self, color: NDArray[np.uint8], depth: NDArray[np.float32], intrinsics: Intrinsics
    ) -> Sequence[Detection]:
        """Return the regions of a frame."""
        started = time.perf_counter()
        found = self.detector.detect(color, depth, intrinsics)
        self.seconds += time.perf_counter() - started
        return found


@dataclass
class TimedPredictor:
    """A predictor that adds up the seconds it takes, and the regions it is given."""

    predictor: Predictor
    seconds: float = 0.0
    regions: int = 0

    def predict(self, clouds: list[NDArray[np.float64]]) -> list[RegionPrediction]:
        """Return one prediction for each cloud."""
        started = time.perf_counter()
        predicted = self.predictor.predict(clouds)
        self.seconds += time.perf_counter() - started
        self.regions += len(clouds)
        return predicted


def measure() -> list[Measurement]:
    """Return the speed on the CPU, and on the GPU where there is one."""
    devices = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    try:
        frames = [source.read() for source in find_frames(FRAMES)]
        return [m for device in devices for m in _on_device(frames, device)]
    except SymgraspError as error:
        return [Measurement("infer", None, "s/frame", str(error))]


def _on_device(frames: list[Frame], device: str) -> list[Measurement]:
    config = InferConfig()
    detector = TimedDetector(models.detector(models.DETECTOR_WEIGHTS, device))
    predictor = TimedPredictor(models.predictor(models.NETWORK_WEIGHTS, device))
    planner = Planner(config, load_gripper(config.gripper), detector, predictor)
    planner.plan(frames[0], np.random.default_rng(0))  # warms caches
    detector.seconds, predictor.seconds, predictor.regions = 0.0, 0.0, 0
    started = time.perf_counter()
    for frame in frames:
        planner.plan(frame, np.random.default_rng(0))
    total = time.perf_counter() - started
    rest, count = total - detector.seconds - predictor.seconds, len(frames)
    note = f"{device}, {count} frames, {predictor.regions / count:.1f} regions a frame"
    return [
        Measurement("infer", total / count, "s/frame", note),
        Measurement("infer: detector", detector.seconds / count, "s/frame", device),
        Measurement("infer: network", predictor.seconds / count, "s/frame", device),
        Measurement("infer: regions by depth, selection", rest / count, "s/frame", "cpu"),
    ]
