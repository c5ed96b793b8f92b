"""Observed points around a region, which a gripper at the region must not meet."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Counts, Mask
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.pointcloud import Plane
from pipelines.grasping.obstacles import Obstacles
from pipelines.grasping.scene import RegionCloud, SceneCloud

Floor = tuple[float, float, float, float]  # a plane as numbers
STEEPEST = math.radians(89.9)  # from the optical axis, of a ray that has a pixel


@dataclass(frozen=True)
class Surroundings:
    """Thinned observed points around a region.

    Attributes:
        all: points above the floor, one per cell, including the region: measured, and unseen ones
            that `with_unseen` adds.
        others: measured points outside of the region, including points beneath the floor.
        center: (3,) metres, centre of the ball that contains the points.
        radius: metres, radius of this ball.
        floor: plane that no gripper goes beneath; None without one.
    """

    all: Obstacles
    others: Obstacles
    center: Array
    radius: float
    floor: Plane | None

    @classmethod
    def of(
        cls,
        region: RegionCloud,
        scene: SceneCloud,
        reach: float,
        resolution: float,
        floor: Plane | None = None,
    ) -> "Surroundings":
        """Return the points within `reach` metres of the region's ball, thinned to `resolution`."""
        low, high = region.points.min(axis=0), region.points.max(axis=0)
        center, radius = (low + high) / 2.0, float(np.linalg.norm(high - low)) / 2.0 + reach
        window = _window(center, radius, scene.intrinsics, scene.depth.shape)
        above, above_count, others, other_count = _cells_about(
            scene.depth,
            scene.intrinsics.image_plane,
            region.mask,
            window,
            center,
            radius,
            resolution,
            _numbers(floor),
        )
        everything, foreign = Obstacles(above, above_count), Obstacles(others, other_count)
        return cls(everything, foreign, center, radius, floor)

    def with_unseen(self, points: Array) -> "Surroundings":
        """Return the surroundings with those of `points` (m, 3) in the ball and above the floor.

        `points` are known by symmetry alone; each counts as one measured point in `all`.
        """
        near = _within(points, self.center, self.radius, _numbers(self.floor))
        if not len(near):
            return self
        joined = np.concatenate([self.all.points, points.take(near, axis=0)])
        count = np.concatenate([self.all.count, np.ones(len(near), np.int64)])
        return replace(self, all=Obstacles(joined, count))


def _window(
    center: Array, radius: float, camera: Intrinsics, shape: tuple[int, ...]
) -> tuple[int, int, int, int]:
    """Return the rows and columns, as start and stop, in which a ball can be seen."""
    x, y, z = center.tolist()
    rows = _span(y, z, radius, (camera.fy, camera.cy), shape[0])
    columns = _span(x, z, radius, (camera.fx, camera.cx), shape[1])
    return *rows, *columns


def _span(
    aside: float, ahead: float, radius: float, lens: tuple[float, float], size: int
) -> tuple[int, int]:
    """Return the first pixel along an axis of the image in which a ball can be seen, and the end.

    `lens`: focal length and principal point along the axis; `size`: pixels of the image.
    """
    # Of the rays in a plane, those that touch the ball are at equal angles to its centre's ray.
    middle, half = math.atan2(aside, ahead), math.asin(min(1.0, radius / math.hypot(aside, ahead)))
    first, last = (
        lens[1] + lens[0] * math.tan(min(max(angle, -STEEPEST), STEEPEST))
        for angle in (middle - half, middle + half)
    )
    return min(max(0, math.floor(first)), size), min(max(0, math.ceil(last) + 1), size)


def _numbers(floor: Plane | None) -> Floor:
    """Return a plane's normal and offset for compiled loops; all points are above None."""
    return (0.0, 0.0, 0.0, np.inf) if floor is None else (*floor.normal.tolist(), floor.offset)


@compiled
def _within(points: Array, center: Array, radius: float, floor: Floor) -> Counts:
    """Return indices of `points` (n, 3) in a ball and above the floor."""
    found, count = np.empty(len(points), np.int64), 0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        u, v, w = x - center[0], y - center[1], z - center[2]
        found[count] = n
        count += (u * u + v * v + w * w < radius * radius) & _is_above(floor, x, y, z)
    return found[:count]


@compiled
def _is_above(floor: Floor, x: float, y: float, z: float) -> bool:
    return floor[0] * x + floor[1] * y + floor[2] * z + floor[3] > 0


@compiled
def _cells_about(
    depth: Array,
    image_plane: tuple[Array, Array],
    own: Mask,
    window: tuple[int, int, int, int],
    center: Array,
    radius: float,
    cell: float,
    floor: Floor,
) -> tuple[Array, Counts, Array, Counts]:
    """Return the first point (n, 3) of each cell of a ball, and the number (n,) of its points.

    First for the points above the floor, then for points outside of the region's `own` (h, w).
    Cells are cubes of edge `cell`, separate for the region and the others, in order of x, y and z.
    `image_plane`: x (w,) of columns and y (h,) of rows at depth 1.
    """
    top, bottom, left, right = window
    pixels, side = max(0, bottom - top) * max(0, right - left), int(2 * radius / cell) + 2
    # Cells at one x and y form a linked list, nearest first: `nearest` is its first cell, `behind`
    # the next. `level`: twice the step of z, plus 1 for the region's own cells.
    nearest, behind = np.full(side * side, -1, np.int32), np.empty(pixels, np.int32)
    level, count = np.empty(pixels, np.int32), np.empty(pixels, np.int32)
    points, found, per_metre = np.empty((pixels, 3)), 0, 1.0 / cell
    last_xy, last = -1, 0  # most pixels show the same cell as their neighbour
    for i in range(top, bottom):
        for j in range(left, right):
            z = depth[i, j]
            x, y = image_plane[0][j] * z, image_plane[1][i] * z
            u, v, w = x - center[0], y - center[1], z - center[2]
            if not ((z > 0) & (u * u + v * v + w * w < radius * radius)):
                continue
            at_xy = int((u + radius) * per_metre) * side + int((v + radius) * per_metre)
            this = np.int32(2 * int((w + radius) * per_metre) + own[i, j])
            if at_xy == last_xy and level[last] == this:
                count[last] += 1
                continue
            before, at = -1, nearest[at_xy]
            while at >= 0 and level[at] < this:
                before, at = at, behind[at]
            if at < 0 or level[at] != this:
                points[found, 0], points[found, 1], points[found, 2] = x, y, z
                level[found], count[found], behind[found] = this, 0, at
                at, found = found, found + 1
                if before < 0:
                    nearest[at_xy] = at
                else:
                    behind[before] = at
            count[at] += 1
            last_xy, last = at_xy, at
    return _in_order(nearest, behind, level, points[:found], count, floor)


@compiled
def _in_order(
    nearest: NDArray[np.int32],
    behind: NDArray[np.int32],
    level: NDArray[np.int32],
    points: Array,
    count: NDArray[np.int32],
    floor: Floor,
) -> tuple[Array, Counts, Array, Counts]:
    """Return the result of `_cells_about` from the lists that start at `nearest` (m,)."""
    above, above_count = np.empty_like(points), np.empty(len(points), np.int64)
    others, other_count = np.empty_like(points), np.empty(len(points), np.int64)
    n, k = 0, 0
    for start in nearest:
        at = start
        while at >= 0:
            x, y, z = points[at, 0], points[at, 1], points[at, 2]
            if _is_above(floor, x, y, z):
                above[n, 0], above[n, 1], above[n, 2], above_count[n] = x, y, z, count[at]
                n += 1
            if level[at] & 1 == 0:
                others[k, 0], others[k, 1], others[k, 2], other_count[k] = x, y, z, count[at]
                k += 1
            at = behind[at]
    return above[:n], above_count[:n], others[:k], other_count[:k]
