"""`infer` on the bundled frames: seconds per frame over a folder, by step, and a lower bound."""

import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch

import pipelines
from benchmarks.bench_machine import sgemm_rate
from benchmarks.operations import gflop_of
from benchmarks.timing import Measurement
from pipelines import infer
from pipelines.configs import InferConfig
from pipelines.errors import SymgraspError
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import Frame, FrameSource
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.planner import RegionPlanner
from pipelines.inference import models, observation
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.regions import predicted_regions
from pipelines.runtime.batch import BatchOptions

BUNDLED = Path(pipelines.__file__).parent / "weights" / "frames"
STEPS: dict[str, tuple[Any, str]] = {
    "regions by depth": (observation, "geometric_regions"),
    "fit of symmetries": (predicted_regions, "ground_symmetries"),
    "unseen sides": (predicted_regions, "completions"),
    "selection": (RegionPlanner, "plan"),
}


@dataclass
class StepClock:
    """Sum of the processor seconds of steps: the time of one core, independent of other work."""

    seconds: dict[str, float] = field(default_factory=dict)

    def timed(self, step: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return `call` with its seconds added to the sum of `step`."""

        def timed_call(*args: Any, **kwargs: Any) -> Any:  # noqa: ANN401 - as `call`
            started = time.process_time()
            result = call(*args, **kwargs)
            taken = time.process_time() - started
            self.seconds[step] = self.seconds.get(step, 0.0) + taken
            return result

        return timed_call


@dataclass(frozen=True)
class TimedDetector:
    """A detector with its seconds added up."""

    examine: Callable[..., Any]


@dataclass(frozen=True)
class TimedPredictor:
    """A predictor with its seconds added up."""

    predict: Callable[..., Any]


def measure() -> list[Measurement]:
    """Return the speed on the CPU, and on the GPU if there is one."""
    devices = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    try:
        sources = find_frames(BUNDLED)
        return [m for device in devices for m in _on_device(sources, device)]
    except SymgraspError as error:
        return [Measurement("infer", None, "s/frame", str(error))]


def _on_device(sources: Sequence[FrameSource], device: str) -> list[Measurement]:
    count = len(sources)
    with tempfile.TemporaryDirectory() as folder:
        for run in ("warms caches", "measured"):
            started = time.perf_counter()
            paths = infer.InferPaths(BUNDLED, Path(folder) / f"{run}.h5")
            infer.run(paths, InferConfig(), BatchOptions(progress=False), device=device)
            total = time.perf_counter() - started
    note = f"{device}, {count} frames of a folder, reading and writing included, all cores"
    with models.one_thread_each():
        seconds, num_regions = _by_step(sources, device)
    lines = [Measurement("infer", total / count, "s/frame", note)]
    lines += [
        Measurement(f"infer: {step}", taken / count, "CPU-s/frame", f"{device}, one core")
        for step, taken in seconds.items()
    ]
    return [*lines, _floor(sources[0].read(), num_regions / count, device)]


def _by_step(sources: Sequence[FrameSource], device: str) -> tuple[dict[str, float], int]:
    """Return the processor seconds of each step over all frames, and the number of regions."""
    clock, config, found = StepClock(), InferConfig(), 0
    examine = models.detector(models.DETECTOR_WEIGHTS, device).examine
    predict = models.predictor(models.NETWORK_WEIGHTS, device).predict
    planner = Planner(
        config,
        load_gripper(config.gripper),
        TimedDetector(clock.timed("detector", examine)),
        TimedPredictor(clock.timed("network", predict)),
        models.symmetry_critics(),
        models.grasp_critic(),
    )
    with ExitStack() as patches:
        for step, (module, name) in STEPS.items():
            timed = clock.timed(step, getattr(module, name))
            patches.enter_context(patch.object(module, name, timed))
        plan = clock.timed("whole", planner.plan)
        read = clock.timed("reading", lambda source: source.read())
        plan(sources[0].read(), np.random.default_rng(0))
        clock.seconds.clear()
        for source in sources:
            found += len(plan(read(source), np.random.default_rng(0)).regions)
    parts = dict(clock.seconds)
    whole = parts.pop("whole")
    parts["rest"] = whole - sum(taken for step, taken in parts.items() if step != "reading")
    return parts, found


def _floor(frame: Frame, num_regions: float, device: str) -> Measurement:
    """Return the time of the networks' arithmetic at the rate of large matrix products."""
    detector = models.detector(models.DETECTOR_WEIGHTS, device)
    predictor = models.predictor(models.NETWORK_WEIGHTS, device)
    cloud = np.random.default_rng(0).normal(0.0, 0.03, (2000, 3))
    with models.one_thread_each():  # the work of other threads would not be counted
        seen = frame.color, frame.depth, frame.intrinsics
        detection = gflop_of(lambda: detector.examine(*seen))
        region = gflop_of(lambda: predictor.predict([cloud]))
    gflop = detection + num_regions * region
    note = f"{detection:.1f} GFLOP + {num_regions:.1f} regions x {region:.2f}, at SGEMM"
    return Measurement("infer: floor", gflop / sgemm_rate(), "s/frame", f"cpu, {note}")
