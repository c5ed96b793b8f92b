"""The networks and critics of `infer`, each loaded once per process."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Hashable
from contextlib import AbstractContextManager
from functools import lru_cache, partial, wraps
from pathlib import Path
from threading import Lock, RLock, get_ident
from typing import TYPE_CHECKING, Any, TypeVar, cast

import cv2
from threadpoolctl import OpenBLASController, ThreadpoolController

from pipelines.grasping.critics import critic_files
from pipelines.grasping.critics.point_critic import PointCritic
from pipelines.grasping.ranking.ranking import Critic, expected_quality
from pipelines.grasping.symmetries.grounding import SymmetryCritics
from pipelines.storage.files import existing

if TYPE_CHECKING:
    from pipelines.network.detection.detector import RegionDetector
    from pipelines.network.predictor import GraspPredictor

WEIGHTS = Path(__file__).parent.parent / "weights"
DETECTOR_WEIGHTS = WEIGHTS / "detector.safetensors"
NETWORK_WEIGHTS = WEIGHTS / "network.safetensors"
AXIS_CRITIC_WEIGHTS = WEIGHTS / "axis_critic.safetensors"
PLANE_CRITIC_WEIGHTS = WEIGHTS / "plane_critic.safetensors"
GRASP_CRITIC_WEIGHTS = WEIGHTS / "grasp_critic.safetensors"
DRIVERS = ("/dev/nvidiactl", "/dev/kfd", "/dev/dxg")  # of NVIDIA, AMD, and WSL

# The commands that write the weights.
DETECTOR_BY, NETWORK_BY = "symgrasp finetune-detector", "symgrasp train"
AXIS_CRITIC_BY = critic_files.WRITTEN_BY[critic_files.AXES]
PLANE_CRITIC_BY = critic_files.WRITTEN_BY[critic_files.PLANES]
GRASP_CRITIC_BY = critic_files.WRITTEN_BY[critic_files.GRASPS]

Load = TypeVar("Load", bound=Callable[..., object])
_LOADING = RLock()  # several threads may work on frames


def _once(load: Load) -> Load:
    """Return `load` with a cache and a lock: each argument is loaded once, one at a time."""
    kept = lru_cache(maxsize=4)(load)

    @wraps(load)
    def loaded(*args: Hashable) -> object:
        with _LOADING:
            return kept(*args)

    return cast(Load, loaded)


@_once
def detector(path: Path, device: str) -> RegionDetector:
    """Return the region detector of the weights `path`."""
    from pipelines.network.detection.detector import RegionDetector  # noqa: PLC0415 - torch is slow to load

    return RegionDetector.load(existing(path, DETECTOR_BY), device)


@_once
def predictor(path: Path, device: str, mirrored: bool = False) -> GraspPredictor:
    """Return the grasp network of the weights `path`.

    `mirrored`: the network also sees the mirror image of each region (D. 101).
    """
    from pipelines.network.predictor import GraspPredictor  # noqa: PLC0415 - torch is slow to load

    return GraspPredictor.load(existing(path, NETWORK_BY), device, mirrored)


@_once
def axis_critic(path: Path = AXIS_CRITIC_WEIGHTS) -> PointCritic:
    """Return the critic of axes and spheres of the weights `path`."""
    return critic_files.read_point_critic(existing(path, AXIS_CRITIC_BY), critic_files.AXES)


@_once
def symmetry_critics(
    axes: Path = AXIS_CRITIC_WEIGHTS, planes: Path = PLANE_CRITIC_WEIGHTS
) -> SymmetryCritics:
    """Return the critics of the weights `axes` and `planes`."""
    weights = existing(planes, PLANE_CRITIC_BY)
    of_planes = critic_files.read_point_critic(weights, critic_files.PLANES)
    return SymmetryCritics(axis_critic(axes), of_planes)


@_once
def grasp_critic(path: Path = GRASP_CRITIC_WEIGHTS) -> Critic:
    """Return the grasp critic of the weights `path`."""
    weights = existing(path, GRASP_CRITIC_BY)
    return partial(expected_quality, critic_files.read_point_critic(weights, critic_files.GRASPS))


def uses_gpu(device: str) -> bool:
    """Return whether networks on `device` run on a GPU; loads torch only where it can matter."""
    if device != "auto":
        return device != "cpu"
    if sys.platform == "linux" and not any(Path(driver).exists() for driver in DRIVERS):
        return False  # loading torch takes seconds
    from pipelines.network.devices import find_device  # noqa: PLC0415 - slow to load

    return find_device(device).type != "cpu"


class _OneThreadEach(AbstractContextManager[None]):
    """The threads within `one_thread_each`, and the thread counts that the last one restores.

    Torch keeps a thread count for each thread; the other libraries keep one for the process, which
    threadpoolctl lets only one thread change. So control is taken from that thread.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._depth: Counter[int] = Counter()  # by thread, number of open contexts
        self._torch, self._images = 1, 1  # thread counts before
        self._products: Any = None  # the limit of matrix products

    def __enter__(self) -> None:
        import torch  # noqa: PLC0415 - slow to load

        own = torch.get_num_threads()  # the first call sets the thread's count
        torch.set_num_threads(1)
        with self._lock:
            if not self._depth:
                self._torch, self._images = own, cv2.getNumThreads()
                cv2.setNumThreads(1)
                OpenBLASController.clear_controlling_thread(force=True)
                self._products = _matrix_products().limit(limits=1, user_api="blas")
            self._depth[get_ident()] += 1

    def __exit__(self, *raised: object) -> None:
        import torch  # noqa: PLC0415 - slow to load

        with self._lock:
            self._depth[get_ident()] -= 1
            if self._depth[get_ident()]:
                return
            del self._depth[get_ident()]
            if not self._depth:
                cv2.setNumThreads(self._images)
                OpenBLASController.clear_controlling_thread(force=True)
                self._products.restore_original_limits()
                OpenBLASController.clear_controlling_thread()
            torch.set_num_threads(self._torch)  # last, because restoring sets OpenMP's count too


_LIMIT = _OneThreadEach()


def one_thread_each() -> AbstractContextManager[None]:
    """Return a context in which networks, OpenCV and numpy's matrix products use one core.

    Frames run in parallel instead, each thread within its `one_thread_each`. Several threads for
    one frame would wait for each other longer than they work, and round sums differently.
    """
    return _LIMIT


@lru_cache(maxsize=1)
def _matrix_products() -> ThreadpoolController:
    """Return the libraries behind numpy's matrix products; the search takes a while."""
    return ThreadpoolController()
