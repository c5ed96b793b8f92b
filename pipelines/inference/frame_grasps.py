"""Planning of one frame: its regions and ranked grasps."""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask
from pipelines.configs import InferConfig
from pipelines.errors import SymgraspError
from pipelines.frames.rgbd import Frame
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.passes import RegionModel, planar_pass, random_pass
from pipelines.grasping.planner import MIN_POINTS, RegionPlanner
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.ranking import Critic
from pipelines.grasping.scene import RegionCloud
from pipelines.grasping.symmetries.grounding import SymmetryCritics
from pipelines.inference.observation import Observation, dropped_instances, observe, why_empty
from pipelines.inference.peers.frame_plans import (
    MOST_GRASPS,
    OWN_SCORE,
    FrameMethod,
    plans_of_frame,
)
from pipelines.inference.plans import Plan, grasp_table, region_table, why_all_weak, with_pieces
from pipelines.inference.regions.predicted_regions import (
    PredictedRegion,
    RegionMethod,
    compared_regions,
    predicted_regions,
    region_models,
)
from pipelines.inference.regions.regions import Region, pieces_of

if TYPE_CHECKING:
    from pipelines.network.detection.detector import RegionDetector
    from pipelines.network.predictor import GraspPredictor


@dataclass(frozen=True)
class Planner:
    """The planner of whole frames; an unused network is None.

    Attributes:
        config: settings of `infer`.
        gripper: the gripper of the grasps.
        detector: of regions.
        predictor: of affordance and symmetries.
        symmetry_critics: score the symmetries that are fitted to a region.
        grasp_critic: scores grasps.
        peer: compared method that finds the grasps instead, in the whole frame.
        symmetry_peer: compared method that finds the symmetries instead; these are not fitted.

    Raises:
        SymgraspError: a network predicts symmetries, and a critic that the settings require is
            missing.
    """

    config: InferConfig
    gripper: Gripper
    detector: "RegionDetector | None" = None
    predictor: "GraspPredictor | None" = None
    symmetry_critics: SymmetryCritics | None = None
    grasp_critic: Critic | None = None
    peer: FrameMethod | None = None
    symmetry_peer: RegionMethod | None = None

    def __post_init__(self) -> None:
        selection = self.config.selection
        if not self._knows_symmetries:
            return
        needs_critics = selection.symmetry.is_fitted and self.symmetry_peer is None
        if needs_critics and self.symmetry_critics is None:
            raise SymgraspError(
                "fitted symmetries need critics, or selection.symmetry.is_fitted=false"
            )
        if selection.ranking.uses_critic and self.grasp_critic is None:
            raise SymgraspError("ranked grasps need a grasp critic, or selection.ranking.by=eq8")

    def plan(
        self,
        frame: Frame,
        rng: np.random.Generator,
        masks: NDArray[np.int32] | None = None,
        workspace: Mask | None = None,
    ) -> FrameResult:
        """Return the regions and grasps of `frame`.

        `masks`: (H, W) the user's instance ids; None for found regions. `workspace`: (H, W) pixels
        where the user allows grasps; None for everywhere.
        """
        started = time.monotonic()
        observation = observe(
            frame, self.config, rng, detector=self.detector, masks=masks, workspace=workspace
        )
        config = self.config
        if self.peer is None:
            regions, plans = self._region_by_region(observation, rng)
            ranker = self._region_planner.ranker
            reason = why_empty(observation, by_masks=masks is not None)
        else:
            regions, plans = plans_of_frame(
                self.peer, frame, observation, self.gripper, config, rng
            )
            config, ranker = replace(config, max_grasps_per_region=MOST_GRASPS), OWN_SCORE
            reason = f"{config.method} finds no allowed grasp with a sufficient score"
        grasps = grasp_table(plans, config, ranker)
        note = "" if masks is None else dropped_instances(observation)
        return FrameResult(
            name=frame.name,
            status="ok" if len(grasps) else "empty",
            message=note if len(grasps) else why_all_weak(plans) or reason,
            intrinsics=frame.intrinsics,
            seconds=time.monotonic() - started,
            regions=region_table(regions, plans),
            grasps=grasps,
        )

    def _region_by_region(
        self, observation: Observation, rng: np.random.Generator
    ) -> tuple[list[Region], list[Plan]]:
        """Return the regions of a frame and the plan of each, in up to three rounds.

        The first round plans every region. The second plans detections without a symmetric grasp
        again, as separate pieces. The third seeks planar grasps for regions that have no grasp yet.
        A piece is the part of a region in one of the segments that the depth shows.
        """
        regions, clouds = observation.in_workspace()
        graspable = [region.is_graspable for region in regions]
        planned = iter(self._region_plans(list(compress(clouds, graspable)), observation, rng))
        plans = [next(planned) if sought else Plan(RankedGrasps.empty()) for sought in graspable]
        if self.config.method == "random":
            return regions, plans
        if self._knows_symmetries and self.config.regions == "auto":
            regions, plans = self._planned_in_pieces(regions, plans, observation, rng)
        plans = [
            self._grasps_on_piece(plan, region.mask, observation)
            if region.is_graspable and not len(plan.grasps)
            else plan
            for plan, region in zip(plans, regions, strict=True)
        ]
        plans = [
            plan.weighted_by(region.confidence) if region.is_rated else plan
            for plan, region in zip(plans, regions, strict=True)
        ]
        return regions, plans

    @cached_property
    def _region_planner(self) -> RegionPlanner:
        """The planner of single regions."""
        selection = self.config.selection
        has_critic = self._knows_symmetries and selection.ranking.uses_critic
        return RegionPlanner(self.gripper, selection, self.grasp_critic if has_critic else None)

    @property
    def _knows_symmetries(self) -> bool:
        """Whether grasps are planned from symmetries."""
        by_network = self.predictor is not None and self.config.method != "random"
        return by_network or self.symmetry_peer is not None

    def _region_plans(
        self, clouds: list[RegionCloud], observation: Observation, rng: np.random.Generator
    ) -> list[Plan]:
        """Return the plan of each of `clouds`, all regions of a frame."""
        planner, selection, scene = self._region_planner, self.config.selection, observation.scene
        if not self._knows_symmetries:
            only = random_pass(rng) if self.config.method == "random" else planar_pass()
            return [Plan(planner.plan(RegionModel(cloud), scene, (only,))) for cloud in clouds]
        large = [index for index, cloud in enumerate(clouds) if len(cloud) >= MIN_POINTS]
        predicted = self._predictions([clouds[i] for i in large], observation)
        is_fitted = selection.symmetry.is_fitted and self.symmetry_peer is None
        critics = self.symmetry_critics if is_fitted else None
        plans = [Plan(RankedGrasps.empty()) for _ in clouds]
        models = region_models(predicted, scene, selection, critics)
        for index, prediction, model in zip(large, predicted, models, strict=True):
            plans[index] = Plan(planner.plan(model, scene), model.symmetries, prediction)
        return plans

    def _predictions(
        self, clouds: list[RegionCloud], observation: Observation
    ) -> list[PredictedRegion]:
        """Return the predictions of the network, or of a compared method, for `clouds`."""
        if self.symmetry_peer is not None:
            return compared_regions(
                clouds, observation.scene, observation.color, self.symmetry_peer
            )
        assert self.predictor is not None
        return predicted_regions(clouds, observation.scene.plane, self.predictor)

    def _planned_in_pieces(
        self,
        regions: list[Region],
        plans: list[Plan],
        observation: Observation,
        rng: np.random.Generator,
    ) -> tuple[list[Region], list[Plan]]:
        """Return regions and plans, with detections without a symmetric grasp in pieces (D. 97)."""
        pieces = self._pieces_of_detections(regions, plans, observation)
        masks = [mask for own in pieces.values() for mask in own]
        clouds = [RegionCloud.from_mask(mask, observation.scene) for mask in masks]
        planned = iter(self._region_plans(clouds, observation, rng))
        of_pieces = {place: list(islice(planned, len(own))) for place, own in pieces.items()}
        return with_pieces(regions, plans, pieces, of_pieces, self.config.geometric_confidence)

    def _pieces_of_detections(
        self, regions: list[Region], plans: list[Plan], observation: Observation
    ) -> dict[int, list[Mask]]:
        """Return the pieces (H, W) of detections without a symmetric grasp, by place in `regions`.

        The largest piece comes first. Detections that stay whole have no pieces.
        """
        config = replace(self.config, min_region_pixels=observation.min_region_pixels)
        labels = observation.segments.labels
        return {
            place: pieces_of(region.mask, labels, config)
            for place, (region, plan) in enumerate(zip(regions, plans, strict=True))
            if region.source == "detector" and not plan.rests_on_symmetry
        }

    def _grasps_on_piece(self, plan: Plan, mask: Mask, observation: Observation) -> Plan:
        """Return `plan` with planar grasps on a piece of `mask` (H, W), if a piece has any."""
        inside, scene = self.config.min_piece_inside, observation.scene
        for segment in observation.segments.masks if self.config.regions != "detector" else ():
            piece = segment & mask
            if np.count_nonzero(piece) < inside * np.count_nonzero(segment):
                continue
            cloud = RegionCloud.from_mask(piece, scene)
            ranked = self._region_planner.plan(RegionModel(cloud), scene, (planar_pass(),))
            if len(ranked):
                return replace(plan, grasps=ranked)
        return plan
