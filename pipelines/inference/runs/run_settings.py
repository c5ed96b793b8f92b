"""Inputs, weights and settings that all frames of a run of `infer` share."""

import logging
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from pipelines.configs import InferConfig, check_settings
from pipelines.configs.inference import FRAME_PEERS, REGION_PEERS, TRAINED_METHODS
from pipelines.errors import ValueRangeError
from pipelines.grasp_files.gripper_files import gripper_digest, load_gripper
from pipelines.grasping.limits import check_limits
from pipelines.grasping.symmetries.by_fitting import symmetries_by_fitting
from pipelines.inference import models
from pipelines.inference.frame_grasps import Planner
from pipelines.inference.peers.registry import frame_method, region_method, written_by
from pipelines.inference.regions.predicted_regions import RegionMethod
from pipelines.storage.files import existing
from pipelines.storage.provenance import digest, digest_tree

log = logging.getLogger(__name__)

WEIGHTS_BY = {  # the commands that write the weights
    "detector": models.DETECTOR_BY,
    "network": models.NETWORK_BY,
    "axis_critic": models.AXIS_CRITIC_BY,
    "plane_critic": models.PLANE_CRITIC_BY,
    "grasp_critic": models.GRASP_CRITIC_BY,
}


@dataclass(frozen=True)
class InferPaths:
    """The input and output paths of `infer`; None for unused inputs and outputs.

    Attributes:
        frames: folder of RGB-D frames.
        output: `grasps.h5`.
        overlays: folder for pictures.
        masks: folder of the user's instance masks, instead of found regions.
        workspace: picture, black where grasps are not allowed.
        detector: weights of the region detector.
        network: weights of the grasp network.
        axis_critic: weights of the critic of axes and spheres.
        plane_critic: weights of the plane critic.
        grasp_critic: weights of the grasp critic.
        peer: weights of a compared method.
    """

    frames: Path
    output: Path
    overlays: Path | None = None
    masks: Path | None = None
    workspace: Path | None = None
    detector: Path = models.DETECTOR_WEIGHTS
    network: Path = models.NETWORK_WEIGHTS
    axis_critic: Path = models.AXIS_CRITIC_WEIGHTS
    plane_critic: Path = models.PLANE_CRITIC_WEIGHTS
    grasp_critic: Path = models.GRASP_CRITIC_WEIGHTS
    peer: Path | None = None

    def with_weights(self, **weights: Path | None) -> "InferPaths":
        """Return the same paths with other weights, by field; None keeps the old path."""
        return replace(self, **{name: path for name, path in weights.items() if path is not None})


@dataclass(frozen=True)
class RunSettings:
    """Settings and inputs that all frames of a run share; picklable."""

    paths: InferPaths
    config: InferConfig
    seed: int
    device: str
    timings: bool

    @property
    def uses_detector(self) -> bool:
        """Whether the region detector runs."""
        return self.config.regions in ("auto", "detector") and self.paths.masks is None

    @property
    def uses_network(self) -> bool:
        """Whether the grasp network runs."""
        return self.config.method == "network"

    @property
    def uses_symmetry_critics(self) -> bool:
        """Whether symmetries are fitted to the seen surface, and critics score the fits."""
        return self.uses_network and self.config.selection.symmetry.is_fitted

    @property
    def uses_grasp_critic(self) -> bool:
        """Whether grasps are ranked by expected quality."""
        rests_on_symmetry = self.config.method in ("network", "symmetry-icp", *REGION_PEERS)
        return rests_on_symmetry and self.config.selection.ranking.uses_critic

    @property
    def uses_peer(self) -> bool:
        """Whether a compared method with trained weights runs."""
        return self.config.method in TRAINED_METHODS

    @property
    def uses(self) -> dict[str, bool]:
        """Whether each model of our own runs, by the field of its weights in `InferPaths`."""
        return {
            "detector": self.uses_detector,
            "network": self.uses_network,
            "axis_critic": self.uses_symmetry_critics,
            "plane_critic": self.uses_symmetry_critics,
            "grasp_critic": self.uses_grasp_critic,
        }

    @property
    def peer_weights(self) -> Path:
        """The weights of the compared method.

        Raises:
            ValueRangeError: no weights are given.
        """
        if self.paths.peer is None:
            made_by = f"weights that `{written_by(self.config.method)}` writes"
            raise ValueRangeError("--weights", "not given", made_by)
        return self.paths.peer

    def weight_digests(self) -> dict[str, str]:
        """Return the digest of each used file of weights, by model."""
        used = [name for name, is_used in self.uses.items() if is_used]
        wanted = [(name, getattr(self.paths, name), WEIGHTS_BY[name]) for name in used]
        if self.uses_peer:
            wanted.append(("peer", self.peer_weights, written_by(self.config.method)))
        return {name: digest(existing(path, made_by)) for name, path, made_by in wanted}

    def warn_of_unused_weights(self) -> None:
        """Warn of each file of weights that is given and not used."""
        for name, is_used in self.uses.items():
            path = getattr(self.paths, name)
            if not is_used and path != getattr(InferPaths, name):
                model = name.replace("_", " ")
                log.warning("%s is not used: with these settings no %s runs", path, model)

    def other_digests(self) -> dict[str, str]:
        """Return the digests of the gripper, the user's masks and the workspace, by input."""
        others = {"gripper": gripper_digest(self.config.gripper)}
        if self.paths.masks is not None:
            others["masks"] = digest_tree(self.paths.masks, (".png",))
        if self.paths.workspace is not None:
            others["workspace"] = digest(self.paths.workspace)
        return others

    def one_core(self) -> AbstractContextManager[None]:
        """Return a context in which networks, if any run, use one core for each frame."""
        uses = self.uses_detector or self.uses_network or self.uses_peer
        return models.one_thread_each() if uses else nullcontext()

    def planner(self) -> Planner:
        """Return the planner; its networks are loaded once per process."""
        paths, device, mirrored = self.paths, self.device, self.config.mirrored
        gripper, method = load_gripper(self.config.gripper), self.config.method
        return Planner(
            self.config,
            gripper,
            models.detector(paths.detector, device) if self.uses_detector else None,
            models.predictor(paths.network, device, mirrored) if self.uses_network else None,
            models.symmetry_critics(paths.axis_critic, paths.plane_critic)
            if self.uses_symmetry_critics
            else None,
            models.grasp_critic(paths.grasp_critic) if self.uses_grasp_critic else None,
            frame_method(method, self.peer_weights, gripper, device)
            if method in FRAME_PEERS
            else None,
            self._symmetry_peer(),
        )

    def _symmetry_peer(self) -> RegionMethod | None:
        """Return the compared method that finds symmetries of regions, if one is configured."""
        method = self.config.method
        if method in REGION_PEERS:
            return region_method(method, self.peer_weights, self.device)
        if method == "symmetry-icp":
            return lambda cloud, scene, _color: symmetries_by_fitting(cloud, scene)
        return None


def check_config(config: InferConfig) -> None:
    """Raise SymgraspError unless all values in `config` are known and its limits are valid."""
    check_settings(config)
    check_limits(config.limits)
    load_gripper(config.gripper)
