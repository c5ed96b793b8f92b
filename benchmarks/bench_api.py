"""`GraspDetector` on the bundled frames, warm, and the command `infer` in a new process."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import torch

from benchmarks.timing import Measurement, cpu_seconds_of, seconds_of
from pipelines.errors import SymgraspError
from pipelines.inference.models import WEIGHTS
from symgrasp import GraspDetector, bundled_frame

NAMES = ("table_1", "table_2", "table_3", "table_4")


def measure() -> list[Measurement]:
    """Return the seconds per frame on the CPU, and on the GPU if there is one."""
    devices = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
    try:
        return [line for device in devices for line in _on_device(device)]
    except SymgraspError as error:
        return [Measurement("api", None, "s/frame", str(error))]


def _on_device(device: str) -> list[Measurement]:
    detector, frames = GraspDetector(device=device), [bundled_frame(name) for name in NAMES]

    def all_frames() -> None:
        for frame in frames:
            detector(*frame)

    warm = f"{device}, models loaded, {len(frames)} frames one after the other"
    new = f"{device}, `symgrasp infer` on one frame in a new process"
    wall, busy = _of_the_command(device)
    return [
        Measurement("api", seconds_of(all_frames) / len(frames), "s/frame", warm),
        Measurement("api", cpu_seconds_of(all_frames) / len(frames), "CPU-s/frame", warm),
        Measurement("api: the command", wall, "s/frame", new),
        Measurement("api: the command", busy, "CPU-s/frame", new),
    ]


def _of_the_command(device: str) -> tuple[float, float]:
    """Return the wall-clock and processor seconds of one frame, with start and end of Python."""
    frame = WEIGHTS / "frames" / f"{NAMES[0]}_depth.png"

    with tempfile.TemporaryDirectory() as folder:
        out = ["--out", str(Path(folder) / "grasps.h5"), "--overwrite", "--device", device]
        command = [sys.executable, "-m", "symgrasp", "infer", str(frame), *out]
        for _run in ("warms caches", "measured"):
            started, before = time.perf_counter(), os.times()
            subprocess.run(command, check=True, capture_output=True)
            wall, after = time.perf_counter() - started, os.times()
    user = after.children_user - before.children_user
    return wall, user + after.children_system - before.children_system
