"""Predictions for one frame: its regions, and a method's best grasp and symmetries on each."""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.errors import SymgraspError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.symmetry import SPHERE_SLOT, SymmetrySlots
from pipelines.grasp_files.grasp_checks import refuse_wrong_grasps
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable, RegionTable
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps


@dataclass(frozen=True)
class RowPredictions:
    """Predictions of one method, camera frame; lists have one entry per region of the frame."""

    best: list[GraspPoses]  # empty or one grasp
    rank_score: list[float]  # of the best grasp; -inf without a grasp
    symmetries: list[SymmetrySlots] | None = None  # None for a method that predicts none
    every: "ScoredGrasps | None" = None  # all grasps of the frame; None without any

    @classmethod
    def from_ranked(
        cls, ranked: list[RankedGrasps], symmetries: list[SymmetrySlots] | None = None
    ) -> "RowPredictions":
        """Return the best grasp of each region; `ranked` has the best grasp first."""
        score = [float(r.rank_score[0]) if len(r) else -np.inf for r in ranked]
        every = RankedGrasps.concatenate([RankedGrasps.empty(), *ranked])
        scored = ScoredGrasps(every.grasps, every.rank_score)
        return cls([r.grasps[:1] for r in ranked], score, symmetries, scored)


@dataclass(frozen=True)
class ScoredGrasps:
    """Grasps of a frame, camera frame, with the score (n,) of each."""

    grasps: GraspPoses
    score: Array

    @classmethod
    def of(cls, table: GraspTable) -> "ScoredGrasps":
        """Return the grasps of a frame's table."""
        grasps = GraspPoses(table.rotation, table.translation, table.width)
        return cls(grasps, table.rank_score.astype(np.float64))


@dataclass(frozen=True)
class FramePredictions:
    """The results of `infer` on one frame; lists have one entry per region, masks are (H, W).

    `anywhere`: grasps of a compared method that knows no regions; None for other methods.
    `intrinsics`: of the camera that the frame was read with; None if it could not be read.
    """

    name: str
    seconds: float
    masks: list[Mask]
    confidence: list[float]
    row: RowPredictions
    anywhere: ScoredGrasps | None = None
    intrinsics: Intrinsics | None = None

    @classmethod
    def from_result(cls, result: FrameResult, *, knows_regions: bool = True) -> "FramePredictions":
        """Return the predictions of one frame of a `grasps.h5`.

        `knows_regions`: the method grasps regions, not whole frames.

        Raises:
            SymgraspError: as `refuse_wrong_grasps`, with the frame's name.
        """
        regions, grasps = result.regions, result.grasps
        try:
            refuse_wrong_grasps(grasps)
        except SymgraspError as error:
            raise SymgraspError(f"{result.name}: {error}") from error
        best: list[GraspPoses] = [GraspPoses.empty() for _ in range(len(regions))]
        score = [-np.inf] * len(regions)
        for i in np.flatnonzero(grasps.is_best).tolist():
            region = int(grasps.region[i])
            best[region] = GraspPoses(grasps.rotation[i], grasps.translation[i], grasps.width[i])
            score[region] = float(grasps.rank_score[i])
        symmetries = [_symmetries(regions, region) for region in range(len(regions))]
        every = ScoredGrasps.of(grasps)
        return cls(
            result.name,
            result.seconds,
            [regions.mask(region, *result.size) for region in range(len(regions))],
            [float(value) for value in regions.confidence],
            RowPredictions(best, score, symmetries, every),
            None if knows_regions else every,
            result.intrinsics,
        )


def _symmetries(regions: RegionTable, region: int) -> SymmetrySlots:
    """Return a region's symmetries; a symmetry without parameters has probability 0."""
    point = np.asarray(regions.symmetry_point[region], np.float64)
    direction = np.asarray(regions.symmetry_direction[region], np.float64)
    known = np.isfinite(point).all(axis=1)
    known &= np.isfinite(direction).all(axis=1) | (np.arange(len(point)) == SPHERE_SLOT)
    stored = regions.symmetry_confidence[region].astype(np.float64)
    return SymmetrySlots(np.where(known, np.nan_to_num(stored), 0.0), point, direction)
