"""Where the picture ends: what it cuts off goes on beyond, unseen, and no finger may go there.

A region that reaches the border of what is measured has no end on that side. Its outline there is
the picture's and no surface, and half of what is seen is not half of it: a second contact put
there would be in the middle of the object.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.camera import Intrinsics
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Sides = tuple[tuple[int, int], tuple[int, int]]  # first and last column, and row, inclusive

AT_BORDER = 4  # pixels: a region that comes so near is cut
FEW = 3  # pixels of a region there that may be noise
FEWEST_MEASURED = 0.05  # of what a full column or row has; some cameras measure none at one side
MOST_MEASURED = 0.8  # of the picture's width, or height, a camera measures at least
BACK = 0.03  # metres behind the tips that must be in view too


@dataclass(frozen=True)
class PictureBorder:
    """The sides at which a region is cut off.

    Attributes:
        intrinsics: of the picture.
        low: (2,) first column and row in which a finger may be, -inf where the region ends.
        high: (2,) last column and row, inf where it ends.
    """

    intrinsics: Intrinsics
    low: Array
    high: Array

    @classmethod
    def of(
        cls, mask: Mask, depth: Array, measured: Sides, intrinsics: Intrinsics
    ) -> "PictureBorder | None":
        """Return where the region `mask` (H, W) is cut; None if it ends within the picture.

        `depth`: (H, W) metres, 0 where missing. `measured`: as `measured_sides` gives it.
        """
        low, high = np.full(2, -np.inf), np.full(2, np.inf)
        for axis, (first, last) in enumerate(measured):  # columns, rows
            for ends, end, start in ((low, first, first), (high, last, last + 1 - AT_BORDER)):
                some = slice(max(0, start), start + AT_BORDER)
                strip = (slice(None), some) if axis == 0 else (some, slice(None))
                if np.count_nonzero(mask[strip] & (depth[strip] > 0.0)) > FEW:
                    ends[axis] = end
        if not (np.isfinite(low).any() or np.isfinite(high).any()):
            return None
        return cls(intrinsics, low, high)

    def is_kept(self, hands: Grasps, gripper: Gripper) -> Mask:
        """Return (n,) which hands have both fingers in view on the sides where the region is cut.

        The fingers' outer faces count, at the tips and some way back.
        """
        kept = np.ones(len(hands), np.bool_)
        out = 0.5 * hands.width + gripper.clearance + gripper.finger_thickness
        for side in (-1.0, 1.0):
            for ahead in (gripper.tip_reach, gripper.tip_reach - BACK):
                points = hands.translation + ahead * hands.approach
                points = points + (side * out)[:, None] * hands.closing
                before = points[:, 2] > 0.0
                pixels = self.intrinsics.project(np.where(before[:, None], points, 1.0))
                kept &= before & ((pixels >= self.low) & (pixels <= self.high)).all(axis=1)
        return kept


def measured_sides(depth: Array) -> Sides:
    """Return the first and the last column, and row, of `depth` (H, W) that hold some depth.

    Those of the picture where what is measured is much smaller: the rest was cut away from a thing.
    """
    measured, sides = depth > 0.0, []
    for axis in range(2):
        count = np.count_nonzero(measured, axis=axis)
        places = np.flatnonzero(count > FEWEST_MEASURED * count.max(initial=0))
        wide = len(places) and places[-1] - places[0] >= MOST_MEASURED * len(count)
        sides.append((int(places[0]), int(places[-1])) if wide else (0, len(count) - 1))
    return sides[0], sides[1]
