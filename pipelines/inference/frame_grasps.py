"""One frame in, its regions and ranked grasps out."""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import InferConfig
from pipelines.errors import SymgraspError
from pipelines.frames.rgbd import Frame
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasp_files.grasps_file import FrameResult
from pipelines.grasping.candidates.completion import completions
from pipelines.grasping.candidates.grounding import SymmetryCritics, ground_symmetries
from pipelines.grasping.grasp_candidates import RankedGrasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.ranking.ranking import Critic
from pipelines.grasping.region_grasping import MIN_POINTS, plan_planar, plan_random, plan_region
from pipelines.inference.empty_frames import why_empty
from pipelines.inference.observation import Observation, observe
from pipelines.inference.pieces import pieces_of
from pipelines.inference.plans import Plan, grasp_table, region_table
from pipelines.inference.predicted_regions import PredictedRegion, Predictor, predicted_regions
from pipelines.inference.regions import Detector, Region


@dataclass(frozen=True)
class Planner:
    """Everything that turns regions into grasps; without networks where these are None.

    Raises:
        SymgraspError: symmetries are to be fitted without critics of them, or grasps to be ranked
            by a critic that is not given.
    """

    config: InferConfig
    gripper: Gripper
    detector: Detector | None = None
    predictor: Predictor | None = None
    symmetry_critics: SymmetryCritics | None = None
    grasp_critic: Critic | None = None

    def __post_init__(self) -> None:
        selection = self.config.selection
        if self.predictor is None:
            return
        if selection.ground_symmetries and self.symmetry_critics is None:
            raise SymgraspError("fitted symmetries need critics, or ground_symmetries=False")
        if selection.uses_grasp_critic and self.grasp_critic is None:
            raise SymgraspError('ranked grasps need a grasp critic, or rank_by="eq8"')

    def plan(
        self,
        frame: Frame,
        rng: np.random.Generator,
        masks: NDArray[np.int32] | None = None,
        workspace: NDArray[np.bool_] | None = None,
    ) -> FrameResult:
        """Return the regions and grasps of `frame`.

        `masks` (H, W) are the user's instance ids, `workspace` (H, W) the pixels where they allow
        grasps; None for found regions and for everywhere.
        """
        started = time.monotonic()
        seen = observe(
            frame, self.config, rng, detector=self.detector, masks=masks, workspace=workspace
        )
        regions, clouds = seen.in_workspace()
        plans = self._plans(clouds, seen.scene, rng)
        if self.config.method != "random":
            regions, plans = self._taken_apart(regions, plans, seen, rng)
            plans = [
                plan if len(plan.grasps) else self._piecewise(plan, region.mask, seen)
                for plan, region in zip(plans, regions, strict=True)
            ]
        grasps = [plan.grasps for plan in plans]
        count = sum(len(ranked) for ranked in grasps)
        least = None if masks is None else self.config.min_region_pixels
        return FrameResult(
            name=frame.name,
            status="ok" if count else "empty",
            message="" if count else why_empty(seen, least),
            intrinsics=frame.intrinsics,
            seconds=time.monotonic() - started,
            regions=region_table(regions, plans),
            grasps=grasp_table(grasps, self.config.max_grasps_per_region),
        )

    @property
    def _critic(self) -> Critic | None:
        """What ranks hands of symmetric regions; None for Eq. 8."""
        critics = self.predictor is not None and self.config.selection.uses_grasp_critic
        return self.grasp_critic if critics else None

    def _plans(
        self, clouds: list[RegionCloud], scene: SceneCloud, rng: np.random.Generator
    ) -> list[Plan]:
        selection = self.config.selection
        if self.config.method == "random":
            return [
                Plan(plan_random(cloud, scene, self.gripper, selection, rng)) for cloud in clouds
            ]
        if self.predictor is None:
            return [Plan(plan_planar(c, scene, self.gripper, selection)) for c in clouds]
        large = [index for index, cloud in enumerate(clouds) if len(cloud) >= MIN_POINTS]
        seen = predicted_regions([clouds[i] for i in large], scene.plane, self.predictor)
        slots = [self._symmetries(each, scene) for each in seen]
        completed = completions([each.cloud for each in seen], scene, slots, selection)
        plans = [Plan(RankedGrasps.empty()) for _ in clouds]
        for index, each, known, unseen in zip(large, seen, slots, completed, strict=True):
            affordance = each.affordance
            ranked = plan_region(
                each.cloud, scene, known, affordance, self.gripper, selection, self._critic, unseen
            )
            plans[index] = Plan(ranked, known, float(affordance.mean()), float(affordance.max()))
        return plans

    def _symmetries(self, seen: PredictedRegion, scene: SceneCloud) -> SymmetrySlots:
        """Return the predicted symmetries of a region, fitted to what is seen of it."""
        if self.symmetry_critics is None or not self.config.selection.ground_symmetries:
            return seen.slots
        return ground_symmetries(
            seen.slots, seen.cloud, scene, self.config.selection, self.symmetry_critics
        )

    def _taken_apart(
        self,
        regions: list[Region],
        plans: list[Plan],
        seen: Observation,
        rng: np.random.Generator,
    ) -> tuple[list[Region], list[Plan]]:
        """Return regions and plans; detections without a symmetric grasp by pieces (D. 97).

        Such a region's symmetries and grasps are those of its largest piece, if that has grasps;
        other pieces that have some become regions of their own.
        """
        config, scene, labels = self.config, seen.scene, seen.segments.labels
        if self.predictor is None or config.regions != "auto":
            return regions, plans
        parts = [
            (index, rank, mask)
            for index, (region, plan) in enumerate(zip(regions, plans, strict=True))
            if region.source == "detector" and not plan.rests_on_symmetry
            for rank, mask in enumerate(pieces_of(region.mask, labels, config))
        ]
        clouds = [RegionCloud.from_mask(mask, scene) for _, _, mask in parts]
        regions, plans = list(regions), list(plans)
        for (index, rank, mask), plan in zip(parts, self._plans(clouds, scene, rng), strict=True):
            if len(plan.grasps) and rank == 0:
                plans[index] = plan
            elif len(plan.grasps):
                regions.append(Region(mask, config.geometric_confidence, "geometric"))
                plans.append(plan)
        return regions, plans

    def _piecewise(self, plan: Plan, mask: NDArray[np.bool_], seen: Observation) -> Plan:
        """Return planar grasps of the geometric pieces of a region that has none as a whole."""
        inside, scene = self.config.min_piece_inside, seen.scene
        for piece in seen.segments.masks:
            if np.count_nonzero(piece & mask) < inside * np.count_nonzero(piece):
                continue
            cloud = RegionCloud.from_mask(piece & mask, scene)
            selection = self.config.selection
            ranked = plan_planar(cloud, scene, self.gripper, selection, self._critic)
            if len(ranked):
                return replace(plan, grasps=ranked)
        return plan
