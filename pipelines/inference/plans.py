"""What was planned for the regions of a frame, and the columns of its result."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasp_files.grasps_file import GraspTable, RegionTable
from pipelines.grasping.grasp_candidates import RankedGrasps
from pipelines.inference.regions import Region


@dataclass(frozen=True)
class Plan:
    """The grasps of one region and what they rest on; affordance nan where none was predicted."""

    grasps: RankedGrasps
    slots: SymmetrySlots | None = None
    affordance_mean: float = np.nan
    affordance_max: float = np.nan

    @property
    def rests_on_symmetry(self) -> bool:
        """Whether the best grasp is a symmetric one."""
        return len(self.grasps) > 0 and bool(self.grasps.slot[0] >= 0)


def region_table(regions: list[Region], plans: list[Plan]) -> RegionTable:
    """Return one frame's regions as columns."""
    slots = [plan.slots or SymmetrySlots.empty() for plan in plans]
    return RegionTable.from_masks(
        [region.mask for region in regions],
        confidence=[region.confidence for region in regions],
        source=[region.source for region in regions],
        existence=np.array([s.existence for s in slots]).reshape(-1, 5),
        symmetry_point=np.array([s.point for s in slots]).reshape(-1, 5, 3),
        symmetry_direction=np.array([s.direction for s in slots]).reshape(-1, 5, 3),
        affordance_mean=[plan.affordance_mean for plan in plans],
        affordance_max=[plan.affordance_max for plan in plans],
    )


def grasp_table(ranked: list[RankedGrasps], limit: int) -> GraspTable:
    """Return the best `limit` grasps of each region as columns, the first of each marked best."""
    kept = [grasps[:limit] for grasps in ranked]
    counts = [len(grasps) for grasps in kept]

    def column(name: str) -> NDArray[Any]:
        return np.concatenate([np.zeros(0), *(getattr(grasps, name) for grasps in kept)])

    def geometry(name: str, shape: tuple[int, ...]) -> NDArray[Any]:
        parts = [getattr(grasps.grasps, name) for grasps in kept]
        return np.concatenate([np.zeros((0, *shape)), *parts])

    return GraspTable(
        region=np.repeat(np.arange(len(kept)), counts),
        rotation=geometry("rotation", (3, 3)),
        translation=geometry("translation", (3,)),
        width=geometry("width", ()),
        contacts=geometry("contacts", (2, 3)),
        affordance=column("affordance"),
        symmetry_slot=column("slot"),
        source=np.concatenate([np.zeros(0, object), *(g.source.astype(object) for g in kept)]),
        clearance=column("clearance"),
        enclosed_height=column("enclosed_height"),
        rank_score=column("rank_score"),
        is_best=np.concatenate([np.zeros(0, bool), *(np.arange(n) == 0 for n in counts)]),
    )
