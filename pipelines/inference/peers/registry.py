"""The compared methods of `infer`, by name, each loaded once per process."""

from functools import lru_cache
from pathlib import Path

from pipelines.grasping.gripper import Gripper
from pipelines.inference.peers.frame_plans import FrameMethod
from pipelines.inference.regions.predicted_regions import RegionMethod
from pipelines.storage.files import existing


def written_by(name: str) -> str:
    """Return the command that writes the weights of the method called `name`."""
    return f"symgrasp train-baseline {name}"


@lru_cache(maxsize=2)
def frame_method(name: str, weights: Path, gripper: Gripper, device: str) -> FrameMethod:
    """Return the method called `name`, one of `configs.inference.FRAME_PEERS`, with its weights.

    Raises:
        MissingInputError: the weights are not there.
    """
    from pipelines.inference.peers.ggcnn import GGCNNMethod  # noqa: PLC0415 - torch is slow to load
    from pipelines.inference.peers.graspnet import GraspNetMethod  # noqa: PLC0415
    from pipelines.inference.peers.multi_grasp import MultiGraspMethod  # noqa: PLC0415
    from pipelines.inference.peers.pointnetgpd import PointNetGPDMethod  # noqa: PLC0415
    from pipelines.network.peers.trained import trained_network  # noqa: PLC0415

    network, config, found = trained_network(name, existing(weights, written_by(name)), device)
    if name == "multi-grasp":
        return MultiGraspMethod(network, gripper, found, config).grasps
    methods = {"gg-cnn": GGCNNMethod, "pointnetgpd": PointNetGPDMethod, "graspnet": GraspNetMethod}
    found_by: FrameMethod = methods[name](network, gripper, found).grasps
    return found_by


@lru_cache(maxsize=2)
def region_method(name: str, weights: Path, device: str) -> RegionMethod:
    """Return the method called `name`, one of `configs.inference.REGION_PEERS`, with its weights.

    Raises:
        MissingInputError: the weights are not there.
    """
    from pipelines.inference.peers.symmetrynet import SymmetryNetMethod  # noqa: PLC0415
    from pipelines.network.peers.trained import trained_network  # noqa: PLC0415

    network, _, found = trained_network(name, existing(weights, written_by(name)), device)
    return SymmetryNetMethod(network, found).symmetries
