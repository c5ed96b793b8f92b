"""The networks and critics of `infer`, loaded once a process."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import cv2
from threadpoolctl import ThreadpoolController

from pipelines.errors import MissingInputError
from pipelines.grasping.ranking import critic_files
from pipelines.grasping.ranking.point_critic import PointCritic
from pipelines.grasping.ranking.ranking import GraspCritic

if TYPE_CHECKING:
    from pipelines.network.detection.detector import RegionDetector
    from pipelines.network.predictor import GraspPredictor

WEIGHTS = Path(__file__).parent.parent / "weights"
DETECTOR_WEIGHTS = WEIGHTS / "detector.safetensors"
NETWORK_WEIGHTS = WEIGHTS / "network.safetensors"
PLANE_CRITIC_WEIGHTS = WEIGHTS / "plane_critic.safetensors"
GRASP_CRITIC_WEIGHTS = WEIGHTS / "grasp_critic.safetensors"
DRIVERS = ("/dev/nvidiactl", "/dev/kfd", "/dev/dxg")  # of NVIDIA, AMD, and WSL
PLANE_CRITIC_BY, GRASP_CRITIC_BY = "tools/train_plane_critic.py", "tools/train_grasp_critic.py"


def existing_weights(path: Path, written_by: str) -> Path:
    """Return `path` if it is there.

    Raises:
        MissingInputError: it is not; the message names the command that writes it.
    """
    if not path.is_file():
        raise MissingInputError(path, written_by)
    return path


_LOADING = Lock()  # several frames may ask at a time


def detector(path: Path, device: str) -> RegionDetector:
    """Return the region detector of the weights `path`."""
    with _LOADING:
        return _detector(path, device)


def predictor(path: Path, device: str, mirrored: bool = False) -> GraspPredictor:
    """Return the grasp network of the weights `path`; `mirrored`: regions' mirror images too."""
    with _LOADING:
        return _predictor(path, device, mirrored)


def plane_critic(path: Path) -> PointCritic:
    """Return the plane critic of the weights `path`."""
    with _LOADING:
        return _critic(path, critic_files.PLANES, PLANE_CRITIC_BY)


def grasp_critic(path: Path) -> GraspCritic:
    """Return the grasp critic of the weights `path`."""
    with _LOADING:
        return GraspCritic(_critic(path, critic_files.GRASPS, GRASP_CRITIC_BY))


def uses_gpu(device: str) -> bool:
    """Return whether networks on `device` run on a GPU; asks torch only where it can matter."""
    if device != "auto":
        return device != "cpu"
    if sys.platform == "linux" and not any(Path(driver).exists() for driver in DRIVERS):
        return False  # asking torch takes seconds
    from pipelines.network.devices import find_device  # noqa: PLC0415 - slow to load

    return find_device(device).type != "cpu"


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let each call of a network, of OpenCV or of numpy's matrix products use one core.

    Frames are worked on side by side instead. What several threads add up differs in the last
    bits, and they wait for each other longer than they work.
    """
    import torch  # noqa: PLC0415 - slow to load

    before, images_before = torch.get_num_threads(), cv2.getNumThreads()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    try:
        with _matrix_products().limit(limits=1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(before)
        cv2.setNumThreads(images_before)


@lru_cache(maxsize=1)
def _matrix_products() -> ThreadpoolController:
    """Return the libraries behind numpy's matrix products; to look for them takes a while."""
    return ThreadpoolController()


@lru_cache(maxsize=2)
def _detector(path: Path, device: str) -> RegionDetector:
    from pipelines.network.detection.detector import RegionDetector  # noqa: PLC0415 - torch is slow to load

    return RegionDetector.load(existing_weights(path, "symgrasp finetune-detector"), device)


@lru_cache(maxsize=2)
def _predictor(path: Path, device: str, mirrored: bool) -> GraspPredictor:
    from pipelines.network.predictor import GraspPredictor  # noqa: PLC0415 - torch is slow to load

    return GraspPredictor.load(existing_weights(path, "symgrasp train"), device, mirrored)


@lru_cache(maxsize=4)
def _critic(path: Path, model: str, written_by: str) -> PointCritic:
    return critic_files.read(existing_weights(path, written_by), model)
