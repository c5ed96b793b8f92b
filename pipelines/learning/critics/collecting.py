"""Collection of a critic's rows: the chain of `infer` on frames with known truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import TrainCriticConfig
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.evaluation.frame_scores import assign_regions
from pipelines.evaluation.truth import TruthReader
from pipelines.geometry.symmetry import REFLECTION_SLOTS, ROTATION_SLOT, SPHERE_SLOT
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.feasibility.openings import with_fitted_openings
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.passes import RegionModel
from pipelines.grasping.planner import MIN_POINTS, RegionPlanner
from pipelines.grasping.ranking.grasp_features import GraspFeatures
from pipelines.grasping.scene import SceneCloud
from pipelines.grasping.symmetries import axis_evidence, plane_evidence
from pipelines.grasping.symmetries.region_evidence import RegionEvidence
from pipelines.grasping.symmetries.sources import SOURCE_BITS
from pipelines.inference import models
from pipelines.inference.observation import observe
from pipelines.inference.regions.predicted_regions import (
    PredictedRegion,
    predicted_regions,
    region_models,
)
from pipelines.learning.critics.critic_rows import CriticRows
from pipelines.learning.critics.kinds import CriticKind
from pipelines.learning.critics.truth import symmetry_truth
from pipelines.metrics.grasp_verdicts import TrueScene, qualities
from pipelines.metrics.symmetry_matching import TrueRegion

NO_REGION = TrueRegion(np.zeros((0, 3)), ())
# Below the quality that prevents further passes, so that grasps of all passes are collected.
HIGHEST_SCORE = 0.5


@dataclass(frozen=True)
class ModelPaths:
    """Weights of the models that candidates are collected with."""

    detector: Path = models.DETECTOR_WEIGHTS
    network: Path = models.NETWORK_WEIGHTS
    axis_critic: Path = models.AXIS_CRITIC_WEIGHTS
    plane_critic: Path = models.PLANE_CRITIC_WEIGHTS


@dataclass(frozen=True)
class ObservedFrame:
    """The regions of a frame as the network sees them, and their truth.

    Attributes:
        scene: measured points and table.
        regions: the network's output for each region.
        object_ids: the object that each region is part of, -1 for none.
        truths: the true region that each region overlaps most.
        true_scene: meshes and poses.
    """

    scene: SceneCloud
    regions: list[PredictedRegion]
    object_ids: list[int]
    truths: list[TrueRegion]
    true_scene: TrueScene


@dataclass(frozen=True)
class Collector:
    """The chain of `infer` up to the candidates of a critic."""

    reader: TruthReader
    paths: ModelPaths
    config: TrainCriticConfig
    seed: int = 0

    @cached_property
    def gripper(self) -> Gripper:
        """The gripper of the collected grasps."""
        return load_gripper(self.config.infer.gripper)

    def rows(
        self, kind: CriticKind, files: FrameFiles, rng: np.random.Generator
    ) -> Iterator[CriticRows]:
        """Yield the candidates of one frame for a `kind` of critic, group by group."""
        frame = self.observed(files)
        match kind.name:
            case "axes":
                return self._axes(frame)
            case "planes":
                return self._planes(frame)
            case "grasps":
                return self._grasps(frame, rng)

    def observed(self, files: FrameFiles) -> ObservedFrame:
        """Return the regions of one frame in which `infer` seeks grasps at first.

        Pieces of a detection (D. 97) depend on the grasps of a grasp critic, and are left out.
        """
        image, truth = self.reader.root.read_frame(files), self.reader.read(files)
        detects = self.config.infer.regions != "geometric"
        detector = models.detector(self.paths.detector, "cpu") if detects else None
        predictor = models.predictor(self.paths.network, "cpu", self.config.infer.mirrored)
        rng = np.random.default_rng(self.seed)
        observation = observe(image, self.config.infer, rng, detector=detector)
        scene, (found, clouds) = observation.scene, observation.in_workspace()
        owners = assign_regions([r.mask for r in found], truth, self.config.evaluate)
        pairs = enumerate(zip(found, clouds, strict=True))
        planned = [i for i, (r, cloud) in pairs if r.is_graspable and len(cloud) >= MIN_POINTS]
        regions = predicted_regions([clouds[i] for i in planned], scene.plane, predictor)
        instances = [owners.instance[i] for i in planned]
        truths = [truth.regions[i] if i >= 0 else NO_REGION for i in instances]
        object_ids = [owners.object_id[i] for i in planned]
        return ObservedFrame(scene, regions, object_ids, truths, truth.scene)

    def _axes(self, frame: ObservedFrame) -> Iterator[CriticRows]:
        """Yield the fitted axes of each region, and its sphere."""
        for region, truth in zip(frame.regions, frame.truths, strict=True):
            evidence = self._evidence(region, frame.scene)
            fitted = axis_evidence.fitted_axes(evidence)
            true = np.array([symmetry_truth(each, truth) for each in fitted.symmetries])
            slot = np.full(len(true), ROTATION_SLOT)
            slot[-1] = SPHERE_SLOT
            inputs = axis_evidence.axis_critic_inputs(fitted, evidence)
            yield CriticRows.of_group(*inputs, true, slot)

    def _planes(self, frame: ObservedFrame) -> Iterator[CriticRows]:
        """Yield the fitted planes of each region."""
        critic = models.axis_critic(self.paths.axis_critic)
        for region, truth in zip(frame.regions, frame.truths, strict=True):
            evidence = self._evidence(region, frame.scene)
            axis = axis_evidence.likely_axis_and_sphere(evidence, critic)[0][0]
            planes = plane_evidence.fitted_planes(evidence, axis)[0]
            true = np.array([symmetry_truth(plane, truth) for plane in planes])
            slot = np.full(len(planes), REFLECTION_SLOTS[0])
            inputs = plane_evidence.plane_critic_inputs(planes, evidence)
            yield CriticRows.of_group(*inputs, true, slot)

    def _evidence(self, region: PredictedRegion, scene: SceneCloud) -> RegionEvidence:
        """Return the evidence of a region, with the sources of candidates that `infer` has."""
        allowed = SOURCE_BITS[self.config.infer.selection.symmetry.candidates]
        return RegionEvidence.of(region.slots, region.cloud, scene, allowed)

    def _grasps(self, frame: ObservedFrame, rng: np.random.Generator) -> Iterator[CriticRows]:
        """Yield some feasible grasps of each pass at each region on an object.

        Their truth is the quality among the true meshes, with the opening of `infer` (D. 92).
        """
        selection, scene = self.config.infer.selection, frame.scene
        critics = None
        if selection.symmetry.is_fitted:
            critics = models.symmetry_critics(self.paths.axis_critic, self.paths.plane_critic)
        planned = region_models(frame.regions, scene, selection, critics)
        for model, object_id in zip(planned, frame.object_ids, strict=True):
            if object_id < 0:
                continue
            for features, checks in self._tried(model, scene, rng):
                chosen = np.sort(rng.permutation(len(features.feasible))[: self.config.max_grasps])
                candidates = features.candidates()[chosen]
                opened = self._opened(features, checks)[chosen]
                yield CriticRows.of_group(
                    features.points()[chosen],
                    candidates[:, :0],
                    candidates,
                    qualities(frame.true_scene, object_id, opened, self.gripper),
                    features.feasible.slot[chosen],
                )

    def _tried(
        self, model: RegionModel, scene: SceneCloud, rng: np.random.Generator
    ) -> list[tuple[GraspFeatures, Feasibility]]:
        """Return the features of the grasps of each pass, which get random scores.

        With each come the checks of symmetric grasps in the same attempt.
        """
        seen: list[GraspFeatures] = []
        tried: list[tuple[GraspFeatures, Feasibility]] = []

        def critic(features: GraspFeatures) -> Array:
            seen.append(features)
            return HIGHEST_SCORE * rng.random(len(features.feasible))

        planner = RegionPlanner(self.gripper, self.config.infer.selection, critic)
        for attempt, _ in planner.attempted(model, scene):
            tried += [(features, attempt.with_own_side) for features in seen]
            seen.clear()
        return tried

    def _opened(self, features: GraspFeatures, checks: Feasibility) -> GraspPoses:
        """Return the grasps with the opening margins that they would get if they were chosen."""
        cap = self.config.infer.selection.ranking.clearance_cap
        return with_fitted_openings(features.feasible, checks, cap).grasps
