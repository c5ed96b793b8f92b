"""The border of the image: a region that the border cuts off continues beyond, out of bounds.

A region that reaches the border of the measured pixels has no end on that side. Its outline there
is the image border, not a surface, and its seen half is not half of the object: a second contact
there would be in the middle of the object.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.geometry.camera import Intrinsics
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.scene import Sides

AT_BORDER = 4  # pixels from the border within which a region is cut
FEW = 3  # pixels of a region at the border that may be noise
BACK = 0.03  # metres behind the tips that must be in view too


@dataclass(frozen=True)
class ImageBorder:
    """The sides at which a region is cut off.

    Attributes:
        intrinsics: intrinsics of the image.
        low: (2,) first column and row for a finger, -inf on sides where the region ends.
        high: (2,) last column and row for a finger, inf on sides where the region ends.
    """

    intrinsics: Intrinsics
    low: Array
    high: Array

    @classmethod
    def of(
        cls, mask: Mask, depth: Array, measured: Sides, intrinsics: Intrinsics
    ) -> "ImageBorder | None":
        """Return the sides at which the region `mask` (H, W) is cut; None without such a side.

        `depth`: (H, W) metres, 0 where missing. `measured`: from `measured_sides`.
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

    def allows(self, grasps: GraspPoses, gripper: Gripper) -> Mask:
        """Return a mask (n,) of grasps with both fingers in view on the sides of the cut.

        The fingers' outer faces must be in view, at the tips and slightly behind.
        """
        kept = np.ones(len(grasps), np.bool_)
        out = 0.5 * grasps.width + gripper.clearance + gripper.finger_thickness
        for side in (-1.0, 1.0):
            for ahead in (gripper.tip_reach, gripper.tip_reach - BACK):
                points = grasps.translation + ahead * grasps.approach
                points = points + (side * out)[:, None] * grasps.closing
                before = points[:, 2] > 0.0
                pixels = self.intrinsics.project(np.where(before[:, None], points, 1.0))
                kept &= before & ((pixels >= self.low) & (pixels <= self.high)).all(axis=1)
        return kept
