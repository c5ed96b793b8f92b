"""Tests of whether a piece of the foreground may be a thing to grasp.

A thing has the size of an object, stands on the support plane and has some of that plane behind it.
Walls, sides of bins, arms and what reaches into the image from outside have not.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.configs import RegionConfig
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.depth_segments import extent
from pipelines.tabletop.footprint import Footprint
from pipelines.tabletop.tabletop import Tabletop

TALL = 1.7  # least height of an object, over the height that stands out from noise
MIN_BORDER = 20  # pixels on the image border from which an object continues outside
FITTED = 500  # points of a piece, about, to which a plane is fitted
BARE = 2000  # points of the support, about, whose side of a piece is looked at
STEEP = np.cos(np.deg2rad(30.0))  # of the angle to the support beyond which a plane may be a wall
BEHIND = 0.01  # metres behind a piece's plane from which the support counts


@dataclass(frozen=True)
class Things:
    """The tests of one frame.

    Attributes:
        xyz: (H, W, 3) metres, camera frame, nan where missing.
        top: the support plane and what stands on it.
        hanging: (H, W) pixels of pieces that do not reach down to the support.
        config: thresholds.
    """

    xyz: Array
    top: Tabletop
    hanging: Mask
    config: RegionConfig

    def may_be(self, mask: Mask) -> bool:
        """Return whether the pixels of `mask` (H, W) may be a thing; True without depth."""
        seen = mask & np.isfinite(self.xyz[..., 2])
        count = np.count_nonzero(seen)
        if not count:
            return True
        if np.count_nonzero(seen & self.hanging) > 0.5 * count:
            return False
        border = sum(int(side.sum()) for side in (mask[0], mask[-1], mask[:, 0], mask[:, -1]))
        return self.has_size_and_place(self.xyz[seen], border)

    def has_size_and_place(self, points: Array, border_pixels: int) -> bool:
        """Return whether the piece of `points` (n, 3) may be a thing.

        `border_pixels`: those of its pixels that lie on the image's border.
        """
        plane, size = self.top.plane, extent(points)
        if size > self.config.max_extent:
            return False
        low = plane is not None and _high(plane, points) < self.config.max_cut_height
        if border_pixels > MIN_BORDER and size > self.config.max_cut_extent and not low:
            return False
        # A strip along the image border, or a large object that reaches in from outside.
        if border_pixels**2 > self.config.max_border * len(points):
            return False
        if plane is None:
            return True
        return self._lies_over_support(points) and not (
            size > self.config.max_cut_extent and self._bounds_support(points, plane)
        )

    def stands_out(self, points: Array) -> bool:
        """Return whether the piece of `points` (n, 3) is higher over the support than noise."""
        if self.top.plane is None:
            return True
        least = TALL * self.top.threshold(median(points[:, 2]), self.config)
        return bool(_high(self.top.plane, points) > least)

    def _lies_over_support(self, points: Array) -> bool:
        some = points[:: max(1, len(points) // FITTED)]
        return bool(self._footprint.contains(some).mean() >= self.config.min_over_support)

    def _bounds_support(self, points: Array, plane: Plane) -> bool:
        """Return whether `points` (n, 3) are of a steep surface with no support behind it."""
        some = points[:: max(1, len(points) // FITTED)]
        middle = some.mean(axis=0)
        normal = np.linalg.svd(some - middle, full_matrices=False)[2][2]
        if abs(normal @ plane.normal) > STEEP:
            return False
        depth = (self._bare - middle) @ (normal * -np.sign(normal @ middle))
        behind = np.count_nonzero(depth < -BEHIND)
        return bool(behind < self.config.min_support_behind * len(depth))

    @cached_property
    def _bare(self) -> Array:
        """(n, 3) points of the bare support, evenly spread."""
        at = np.flatnonzero(self.top.bare)
        return self.xyz.reshape(-1, 3).take(at[:: max(1, len(at) // BARE)], axis=0)

    @cached_property
    def _footprint(self) -> Footprint:
        assert self.top.plane is not None
        return Footprint.around(self._bare, self.top.plane, 0.0)


def _high(plane: Plane, points: Array) -> float:
    return float(quantiles(plane.height(points), 0.9))
