"""The plans of the regions of a frame, as columns of its result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import InferConfig
from pipelines.errors import counted
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasp_files.grasps_tables import GraspTable, RegionTable, are_worth_trying
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.inference.regions.predicted_regions import PredictedRegion
from pipelines.inference.regions.regions import Region


@dataclass(frozen=True)
class Plan:
    """The grasps of one region, with the predictions that give the grasps.

    Attributes:
        grasps: best first.
        symmetries: of the region; None without a prediction.
        predicted: by the network, before the fit; None without a prediction.
    """

    grasps: RankedGrasps
    symmetries: SymmetrySlots | None = None
    predicted: PredictedRegion | None = None

    @property
    def rests_on_symmetry(self) -> bool:
        """Whether the best grasp is a symmetric one."""
        return len(self.grasps) > 0 and bool(self.grasps.slot[0] >= 0)

    def weighted_by(self, probability: float) -> Self:
        """Return the plan with scores and confidences times the `probability` of an object."""
        weighted = replace(self.grasps, rank_score=self.grasps.rank_score * probability)
        symmetries = self.symmetries and self.symmetries.weighted_by(probability)
        return replace(self, grasps=weighted, symmetries=symmetries)

    @property
    def existence(self) -> Array:
        """Probability (5,) of each symmetry slot by the network; nan without a prediction."""
        return np.full(5, np.nan) if self.predicted is None else self.predicted.slots.probability

    def sources(self, slot: Indices) -> NDArray[np.object_]:
        """Return (n,) the source of the symmetry in each `slot` (n,); empty for slot -1."""
        if self.symmetries is None:
            return np.full(len(slot), "", object)
        return np.where(slot >= 0, self.symmetries.source[slot], "").astype(object)

    @property
    def affordance(self) -> Array:
        """Affordance (n,) of the region's points; one nan, (1,), without a prediction."""
        return np.array([np.nan]) if self.predicted is None else self.predicted.affordance


def with_pieces(
    regions: Sequence[Region],
    plans: Sequence[Plan],
    pieces: Mapping[int, Sequence[Mask]],
    plans_of_pieces: Mapping[int, Sequence[Plan]],
    confidence: float,
) -> tuple[list[Region], list[Plan]]:
    """Return regions and plans, with the pieces of some regions and the plans of these pieces.

    A single piece replaces its region (D. 145). Of several pieces, the first, which is the largest,
    gives the region its plan if it has grasps; other pieces with grasps become separate regions
    (D. 97).

    Args:
        regions: of a frame.
        plans: of each of `regions`.
        pieces: masks (H, W), by the place of their region in `regions`.
        plans_of_pieces: plan of each of `pieces`.
        confidence: of separate regions, 0 to 1.
    """
    result, result_plans = list(regions), list(plans)
    for place, masks in pieces.items():
        for rank, (mask, plan) in enumerate(zip(masks, plans_of_pieces[place], strict=True)):
            if len(masks) == 1:
                result[place], result_plans[place] = replace(regions[place], mask=mask), plan
            elif len(plan.grasps) and rank == 0:
                result_plans[place] = plan
            elif len(plan.grasps):
                result.append(Region(mask, confidence, "geometric"))
                result_plans.append(plan)
    return result, result_plans


def region_table(regions: list[Region], plans: list[Plan]) -> RegionTable:
    """Return one frame's regions as columns."""
    symmetries = [plan.symmetries or SymmetrySlots.of([]) for plan in plans]
    return RegionTable.from_masks(
        [region.mask for region in regions],
        confidence=[region.confidence for region in regions],
        source=[region.source for region in regions],
        status=[region.status for region in regions],
        instance=[region.instance for region in regions],
        existence=np.array([plan.existence for plan in plans]).reshape(-1, 5),
        symmetry_confidence=np.array([s.probability for s in symmetries]).reshape(-1, 5),
        symmetry_point=np.array([s.point for s in symmetries]).reshape(-1, 5, 3),
        symmetry_direction=np.array([s.direction for s in symmetries]).reshape(-1, 5, 3),
        affordance_mean=[float(plan.affordance.mean()) for plan in plans],
        affordance_max=[float(plan.affordance.max()) for plan in plans],
    )


def grasp_table(plans: list[Plan], config: InferConfig, ranker: str) -> GraspTable:
    """Return the best grasps of each region as columns; the first grasp of a region is marked best.

    Args:
        plans: of each region.
        config: number of grasps kept per region, and score limits for keeping and for marking.
        ranker: origin of the scores, `critic`, `eq8` or `own`.
    """
    good = [plan.grasps[~(plan.grasps.rank_score < config.min_score)] for plan in plans]
    kept = [grasps[: config.max_grasps_per_region] for grasps in good]
    sources = [plan.sources(grasps.slot) for plan, grasps in zip(plans, kept, strict=True)]
    counts = [len(grasps) for grasps in kept]
    every = RankedGrasps.concatenate([RankedGrasps.empty(), *kept])
    scores, rankers = every.rank_score.astype(np.float32), np.full(len(every), ranker, object)
    return GraspTable(
        region=np.repeat(np.arange(len(kept)), counts),
        rotation=every.grasps.rotation,
        translation=every.grasps.translation,
        width=every.grasps.width,
        contacts=every.grasps.contacts,
        affordance=every.affordance,
        symmetry_slot=every.slot,
        symmetry_source=np.concatenate([np.zeros(0, object), *sources]),
        source=every.source.astype(object),
        clearance=every.clearance,
        enclosed_height=every.enclosed_height,
        rank_score=every.rank_score,
        ranker=rankers,
        worth_trying=are_worth_trying(rankers, scores, config.weak_below),
        is_best=np.concatenate([np.zeros(0, bool), *(np.arange(n) == 0 for n in counts)]),
    )


def why_all_weak(plans: list[Plan]) -> str:
    """Return a sentence that all grasps of a frame score too low; empty without grasps."""
    scores = np.concatenate([np.zeros(0), *(plan.grasps.rank_score for plan in plans)])
    if not len(scores):
        return ""
    grasps = counted(len(scores), "grasp")
    return f"none of {grasps} scores min_score or more; the best has {max(scores):.3f}"
