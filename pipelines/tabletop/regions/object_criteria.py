"""Criteria by which a piece of the foreground may be an object to grasp.

An object has a graspable size, stands on the support plane and has some of that plane behind it.
Walls, sides of bins, arms and objects that reach into the image from outside do not.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import RegionConfig
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import unit
from pipelines.tabletop.depth_segments import extent
from pipelines.tabletop.footprint import Footprint
from pipelines.tabletop.regions.pieces import UNMEASURED
from pipelines.tabletop.tabletop import Tabletop

TALL = 1.7  # least height of an object, in heights that stand out from noise
MIN_BORDER = 20  # pixels on the image border from which an object continues outside
FITTED = 500  # points of a piece, about, to which a plane is fitted
BARE = 2000  # points of the support, about, that are compared with a piece's plane
STEEP = np.cos(np.deg2rad(30.0))  # of the angle to the support from which a plane may be a wall
MAX_HANGING = 0.5  # largest share of an object's pixels that hang above the support
TOP = 0.9  # quantile of the heights of a piece that is its top, against strays
VIEW_ENDS = (0.05, 0.95)  # quantiles of a piece's points along the view, against strays
MAX_DRAWN_OUT = 2.2  # length along the view by width across it; of real objects up to 1.7
BEHIND = 0.01  # metres behind a piece's plane from which the support counts


@dataclass(frozen=True)
class ObjectCriteria:
    """The criteria for objects in one frame.

    Attributes:
        xyz: (H, W, 3) metres, camera frame, nan where missing.
        tabletop: the support plane and the foreground.
        hanging: (H, W) pixels of pieces that do not reach down to the support.
        config: thresholds.
    """

    xyz: Array
    tabletop: Tabletop
    hanging: Mask
    config: RegionConfig

    def may_be_object(self, mask: Mask) -> bool:
        """Return whether the pixels of `mask` (H, W) may be an object; True without depth."""
        pixels = np.flatnonzero(mask)
        points = self.xyz.reshape(-1, 3).take(pixels, axis=0)
        seen = np.isfinite(points[:, 2])
        count = np.count_nonzero(seen)
        if not count:
            return True
        if np.count_nonzero(self.hanging.take(pixels[seen])) > MAX_HANGING * count:
            return False
        return self.has_size_and_place(points[seen], pixels)

    def has_size_and_place(self, points: Array, pixels: Indices) -> bool:
        """Return whether the piece of `points` (n, 3) and flat `pixels` (m,) may be an object."""
        border = np.count_nonzero(self._border.take(pixels))
        outermost = np.count_nonzero(self._outermost.take(pixels))
        plane, size = self.tabletop.plane, extent(points)
        if size > self.config.max_extent:
            return False
        low = plane is not None and top_height(points, plane) < self.config.max_cut_height
        if border > MIN_BORDER and size > self.config.max_cut_extent and not low:
            return False
        # A strip along the image border, or a large object that reaches in from outside.
        if outermost**2 > self.config.max_border * len(points):
            return False
        if plane is None:
            return True
        return self._lies_over_support(points) and not (
            size > self.config.max_cut_extent and self._bounds_support(points, plane)
        )

    def stands_out(self, points: Array) -> bool:
        """Return whether the piece of `points` (n, 3) is higher over the support than noise."""
        if self.tabletop.plane is None:
            return True
        least = TALL * self.tabletop.threshold(median(points[:, 2]), self.config)
        return bool(top_height(points, self.tabletop.plane) > least)

    def is_smear(self, points: Array) -> bool:
        """Return whether the piece of `points` (n, 3) is drawn out along the view (D. 137).

        Sensors invent such points between the edge of an object and the surface behind it.
        """
        middle = np.median(points, axis=0)
        ray = unit(middle)
        along = (points - middle) @ ray
        across = points - middle - along[:, None] * ray
        low, high = quantiles(along, VIEW_ENDS)
        # A uniform spread has a twelfth of its squared width as variance.
        width = np.sqrt(12.0 * np.linalg.eigvalsh(across.T @ across / len(points))[-1])
        return bool(high - low > MAX_DRAWN_OUT * width)

    def _lies_over_support(self, points: Array) -> bool:
        some = strided_at_least(points, FITTED)
        return bool(self._footprint.contains(some).mean() >= self.config.min_over_support)

    def _bounds_support(self, points: Array, plane: Plane) -> bool:
        """Return whether `points` (n, 3) are a steep surface without support behind it."""
        some = strided_at_least(points, FITTED)
        middle = some.mean(axis=0)
        normal = np.linalg.svd(some - middle, full_matrices=False)[2][2]
        if abs(normal @ plane.normal) > STEEP:
            return False
        depth = (self._bare - middle) @ (normal * -np.sign(normal @ middle))
        behind = np.count_nonzero(depth < -BEHIND)
        return bool(behind < self.config.min_support_behind * len(depth))

    @cached_property
    def _outermost(self) -> Mask:
        """The outermost measured pixels (H, W) of rows and columns, near the image's border.

        Stereo and registered depth end a few pixels before the image does.
        """
        measured = np.isfinite(self.xyz[..., 2])
        result = np.zeros_like(measured)
        for image, out in ((measured, result), (measured.T, result.T)):
            for turned, into in ((image, out), (image[::-1], out[::-1])):
                first = turned.argmax(axis=0)
                at = np.flatnonzero((first < UNMEASURED) & turned.any(axis=0))
                into[first[at], at] = True
        return result

    @cached_property
    def _border(self) -> Mask:
        """The pixels (H, W) on the border of the image."""
        border = np.ones(self.xyz.shape[:2], np.bool_)
        border[1:-1, 1:-1] = False
        return border

    @cached_property
    def _bare(self) -> Array:
        """(n, 3) points of the bare support, evenly spread."""
        at = np.flatnonzero(self.tabletop.bare)
        return self.xyz.reshape(-1, 3).take(strided_at_least(at, BARE), axis=0)

    @cached_property
    def _footprint(self) -> Footprint:
        assert self.tabletop.plane is not None
        return Footprint.around(self._bare, self.tabletop.plane, 0.0)


def top_height(points: Array, plane: Plane) -> float:
    """Return the height in metres of the top of a piece of `points` (n, 3) over `plane`."""
    return float(quantiles(plane.height(points), TOP))
