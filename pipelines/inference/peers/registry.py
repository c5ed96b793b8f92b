"""The compared methods of `infer`, by name, each loaded once a process."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from pipelines.grasping.gripper import Gripper
from pipelines.inference.peers.frame_method import FrameMethod
from pipelines.inference.predicted_regions import RegionMethod
from pipelines.storage.files import existing


def frame_method(name: str, weights: Path, gripper: Gripper, device: str) -> FrameMethod:
    """Return the method called `name`, one of `configs.inference.FRAME_PEERS`, with its weights.

    Raises:
        MissingInputError: the weights are not there.
    """
    return _frame_method(name, existing(weights, written_by(name)), gripper, device)


def region_method(name: str, weights: Path, device: str) -> RegionMethod:
    """Return the method called `name`, one of `configs.inference.REGION_PEERS`, with its weights.

    Raises:
        MissingInputError: the weights are not there.
    """
    return _region_method(name, existing(weights, written_by(name)), device)


def written_by(name: str) -> str:
    """Return the command that writes the weights of the method called `name`."""
    return f"symgrasp train-baseline {name}"


@lru_cache(maxsize=2)
def _frame_method(name: str, weights: Path, gripper: Gripper, device: str) -> FrameMethod:
    from pipelines.inference.peers.ggcnn import GGCNNMethod  # noqa: PLC0415 - torch is slow to load
    from pipelines.inference.peers.graspnet import GraspNetMethod  # noqa: PLC0415
    from pipelines.inference.peers.multi_grasp import MultiGraspMethod  # noqa: PLC0415
    from pipelines.inference.peers.pointnetgpd import PointNetGPDMethod  # noqa: PLC0415
    from pipelines.network.peers.trained import trained_network  # noqa: PLC0415

    network, config, found = trained_network(name, weights, device)
    if name == "multi-grasp":
        return MultiGraspMethod(network, gripper, found, config)
    methods: dict[str, Callable[..., FrameMethod]] = {
        "gg-cnn": GGCNNMethod,
        "pointnetgpd": PointNetGPDMethod,
        "graspnet": GraspNetMethod,
    }
    return methods[name](network, gripper, found)


@lru_cache(maxsize=2)
def _region_method(name: str, weights: Path, device: str) -> RegionMethod:
    from pipelines.inference.peers.symmetrynet import SymmetryNetMethod  # noqa: PLC0415
    from pipelines.network.peers.trained import trained_network  # noqa: PLC0415

    network, _, found = trained_network(name, weights, device)
    return SymmetryNetMethod(network, found)
