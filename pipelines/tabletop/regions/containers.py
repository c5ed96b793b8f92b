"""Open containers as one region: the outside, and the inside that is seen over the rim.

The rim of a pot separates outside and inside by a depth step and a sharp fold. The inside begins
right behind the edge of a wall without a lid, and is seen through the outline of one rim (D. 134).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from pipelines.array_types import Array, Mask
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.transforms import cross, unit
from pipelines.tabletop.depth_segments import BULK_ENDS, Labels
from pipelines.tabletop.regions.object_criteria import ObjectCriteria
from pipelines.tabletop.regions.pieces import Box, box_of, with_margin

RIM = 0.012  # metres below the highest points that count as one rim
HIGHEST = 0.97  # quantile of the heights of outside and inside that is the rim's
WALL = 0.004  # metres, median deviation along the view within an edge; a lid of 2 cm has more
STRIP = 0.006  # metres across the view, over which that deviation is measured
MIN_OPEN = 0.3  # share of the mouth that shows the inside below its rim
MIN_THROUGH = 0.85  # share of the inside that is seen through the mouth
MIN_BESIDE = 0.5  # share of the outside below the rim that is seen next to the mouth
MIN_COMMON = 0.4  # common share of the widths of outside and inside, across the view
MAX_SOLID = 0.3  # share of the rim in the middle of the mouth; a lid has more
MIDDLE = 0.6  # size of that middle, relative to the mouth
GAP = 9  # pixels, width of a square that bridges outside and inside
MIN_RIM = 15  # least pixels of the rim on the outside, and on the inside


def insides(labels: Labels, criteria: ObjectCriteria) -> dict[int, int]:
    """Return the pairs of regions of `labels` that are one container: {inside: outside}.

    No outside is an inside. `labels`: (H, W) 1, 2, ... n for regions, of the size of `criteria`.
    """
    plane = criteria.tabletop.plane
    if plane is None:
        return {}
    labels = np.where(np.isfinite(criteria.xyz[..., 2]), labels, 0)
    found: dict[int, int] = {}
    for outside, box in _boxes(labels):
        if outside in found:
            continue
        own = labels[box] == outside
        near = cv2.dilate(own.view(np.uint8), np.ones((GAP, GAP), np.uint8)) > 0
        touched = np.bincount(labels[box][near & ~own])
        for inside in np.flatnonzero(touched >= MIN_RIM).tolist():
            if inside == 0 or inside in found or inside in found.values():
                continue
            both = box_of((labels == outside) | (labels == inside))
            cut, xyz = labels[both], criteria.xyz[both]
            pair = _Pair(cut == outside, cut == inside, plane.height(xyz), xyz)
            if pair.is_container(plane.normal):
                found[inside] = outside
    return found


def _boxes(labels: Labels) -> Iterator[tuple[int, Box]]:
    """Yield each label of `labels` (H, W) and its bounding box, widened by the gap."""
    for index, box in enumerate(find_objects(labels), 1):
        if box is not None:
            yield index, with_margin((box[0], box[1]), GAP)


@dataclass(frozen=True)
class _Pair:
    """Possible outside and inside of one container, in a window (h, w) of the image.

    `height`: (h, w) metres over the table. `xyz`: (h, w, 3) metres, camera frame.
    """

    outside: Mask
    inside: Mask
    height: Array
    xyz: Array

    def is_container(self, up: Array) -> bool:
        """Return whether a wall without a lid and the region seen over the wall have one rim.

        `up`: (3,) unit, camera frame, away from the table.
        """
        both = self.outside | self.inside
        rim = both & (self.height > quantiles(self.height[both], HIGHEST) - RIM)
        edge = rim & self.outside
        if np.count_nonzero(edge) < MIN_RIM or np.count_nonzero(rim & self.inside) < MIN_RIM:
            return False
        # The rim is level, so its outline in the image is the outline of the mouth.
        corners = cv2.convexHull(np.argwhere(rim)[:, ::-1].astype(np.int32)).reshape(-1, 2)
        mouth = _filled(corners, rim.shape)
        middle = corners.mean(axis=0)
        core = _filled(middle + MIDDLE * (corners - middle), rim.shape)
        within = self.inside & mouth
        through = np.count_nonzero(within) >= MIN_THROUGH * np.count_nonzero(self.inside)
        is_open = np.count_nonzero(within & ~rim) >= MIN_OPEN * np.count_nonzero(mouth)
        solid = np.count_nonzero(rim & core) > MAX_SOLID * np.count_nonzero(rim)
        below = self.outside & ~rim
        beside = np.count_nonzero(below & ~mouth) >= MIN_BESIDE * np.count_nonzero(below)
        return bool(through and is_open and beside and not solid and self._is_wall(edge, up))

    def _is_wall(self, edge: Mask, up: Array) -> bool:
        """Return whether the outside is as wide as the inside, and has no lid at its `edge`."""
        view = self.xyz[edge].mean(axis=0)
        ahead = unit(view - (view @ up) * up)
        right = cross(ahead, up)
        spans = [  # from left to right, of outside and of inside
            quantiles(self.xyz[part] @ right, BULK_ENDS) for part in (self.outside, self.inside)
        ]
        starts, ends = np.transpose(spans)
        if ends.min() - starts.max() < MIN_COMMON * (ends.max() - starts.min()):
            return False
        along, across = self.xyz[edge] @ ahead, self.xyz[edge] @ right
        _, strip = np.unique(np.floor(across / STRIP), return_inverse=True)
        count = np.bincount(strip)
        error = along - (np.bincount(strip, along) / count)[strip]
        return bool(median(np.abs(error)) < WALL)


def _filled(corners: NDArray[np.number], shape: tuple[int, ...]) -> Mask:
    """Return the convex outline (h, w) of `corners` (n, 2), column and row."""
    image = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(image, np.round(corners).astype(np.int32), 1)
    return image > 0
