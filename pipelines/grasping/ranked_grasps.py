"""Feasible grasps of one region, ranked."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices
from pipelines.grasping.grasps import GraspPoses, Index


@dataclass(frozen=True)
class RankedGrasps:
    """Feasible grasps of one region, best first. Camera frame, metres.

    Attributes:
        grasps: n grasps.
        affordance: (n,) affordance of the first contact.
        slot: (n,) symmetry slot, -1 without symmetry.
        source: (n,) `network`, `planar` or `random`, or a compared method.
        clearance: (n,) b of Eq. 8 in metres, capped.
        enclosed_height: (n,) h of Eq. 8 in metres, capped.
        rank_score: (n,) the grasp critic's expected quality (D. 82), reduced by the torque of the
            weight (D. 143); or s of Eq. 8, reduced in unseen space (D. 68); or a compared method's
            own score.
    """

    grasps: GraspPoses
    affordance: Array
    slot: Indices
    source: NDArray[np.str_]
    clearance: Array
    enclosed_height: Array
    rank_score: Array

    @classmethod
    def empty(cls) -> "RankedGrasps":
        """Return no grasps."""
        zero, slot, source = np.zeros(0), np.zeros(0, np.int64), np.zeros(0, "U7")
        return cls(GraspPoses.empty(), zero, slot, source, zero, zero, zero)

    @classmethod
    def concatenate(cls, parts: Sequence["RankedGrasps"]) -> "RankedGrasps":
        """Return all grasps of `parts`, in order."""
        names = [field.name for field in fields(cls)[1:]]
        columns = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
        return cls(GraspPoses.concatenate([part.grasps for part in parts]), *columns)

    def __len__(self) -> int:
        return len(self.grasps)

    def __getitem__(self, index: Index) -> "RankedGrasps":
        return RankedGrasps(*(getattr(self, field.name)[index] for field in fields(self)))
