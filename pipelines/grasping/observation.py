"""What one frame shows: the observed scene, and one region of it. Camera frame, metres."""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import median
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import unit
from pipelines.grasping.feasibility.collision import Obstacles
from pipelines.grasping.feasibility.image_border import PictureBorder, Sides, measured_sides
from pipelines.grasping.feasibility.limits import Limits
from pipelines.tabletop.organized import smooth_normals

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]
Floor = tuple[float, float, float, float]  # a plane as numbers

MAX_RANGE = 3.0  # metres; nothing farther is ever near a gripper
NORMAL_RADIUS = 3  # pixels
COARSE = 3  # pixels: the step at which the whole scene is an obstacle
NEVER_MET = 0.002  # metres over the table, where no hand comes
STRAY = 0.012  # metres from the median of the neighbours: a pixel between two surfaces


@dataclass(frozen=True)
class Surroundings:
    """The observed points around a region, thinned.

    Attributes:
        points: (n, 3) measured points above the floor, one a cell.
        count: (n,) measured points in the cell that each stands for.
        others: all that do not belong to the region, beneath the floor as well.
        centre, radius: (3,), metres; of the ball that they lie in.
        floor: beneath which no hand comes; None for none.
        border: where the picture cuts the region off; None where it does not.
    """

    points: Array
    count: Counts
    others: Obstacles
    centre: Array
    radius: float
    floor: Plane | None
    border: PictureBorder | None = None

    @cached_property
    def met(self) -> Obstacles:
        """All of the points, as a hand may meet them."""
        return Obstacles(self.points, self.count)

    def with_unseen(self, points: Array) -> "Surroundings":
        """Return these and those of `points` (m, 3), known by symmetry alone, that lie in the ball.

        Each counts as one measured point; `others` stay as they are.
        """
        near = _within(points, self.centre, self.radius, _numbers(self.floor))
        if not len(near):
            return self
        return replace(
            self,
            points=np.concatenate([self.points, points.take(near, axis=0)]),
            count=np.concatenate([self.count, np.ones(len(near), np.int64)]),
        )


@dataclass(frozen=True)
class SceneCloud:
    """A depth image as obstacles, and the support plane.

    Attributes:
        depth: (H, W) metres, 0 where missing.
        intrinsics: of the depth image.
        plane: camera frame, normal to the camera's side; None where none is known.
        limits: what its grasps must keep to; None for nothing.
    """

    depth: Array
    intrinsics: Intrinsics
    plane: Plane | None = None
    limits: Limits | None = None

    @cached_property
    def xyz(self) -> Array:
        """(H, W, 3) points, nan where missing."""
        return self.intrinsics.backproject(self.depth)

    @cached_property
    def stray(self) -> Mask:
        """(H, W) pixels that float between two surfaces, as depth sensors make at edges."""
        depth = np.asarray(self.depth, np.float32)
        return np.asarray(np.abs(cv2.medianBlur(depth, 5) - depth) > STRAY)

    @cached_property
    def coarse(self) -> Obstacles:
        """Every third pixel's point as an obstacle, without strays and what lies on the table."""
        some = (slice(COARSE // 2, None, COARSE),) * 2
        points = self.xyz[some]
        points = points[(self.depth[some] > 0) & (points[..., 2] < MAX_RANGE) & ~self.stray[some]]
        if self.plane is not None:
            points = points[self.plane.height(points) > NEVER_MET]
        return Obstacles(points, np.full(len(points), COARSE**2))

    @property
    def inward(self) -> Array | None:
        """Unit direction (3,) into the table; None without a plane."""
        return None if self.plane is None else -self.plane.normal

    def around(
        self, region: "RegionCloud", reach: float, resolution: float, floor: Plane | None = None
    ) -> Surroundings:
        """Return the points within `reach` metres of the region's ball, thinned to `resolution`."""
        low, high = region.points.min(axis=0), region.points.max(axis=0)
        centre, radius = (low + high) / 2.0, float(np.linalg.norm(high - low)) / 2.0 + reach
        window, image_plane = self._window(centre, radius), self.intrinsics.image_plane
        seen = self.depth, image_plane, region.mask, window
        points, count, other_points, other_count = _cells_about(
            *seen, centre, radius, resolution, _numbers(floor)
        )
        others = Obstacles(other_points, other_count)
        border = PictureBorder.of(region.mask, self.depth, self._measured, self.intrinsics)
        return Surroundings(points, count, others, centre, radius, floor, border)

    @cached_property
    def _measured(self) -> Sides:
        return measured_sides(self.depth)

    def _window(self, centre: Array, radius: float) -> tuple[int, int, int, int]:
        """Return the rows and columns, each first and behind the last, a ball can be seen in."""
        nearest = max(centre[2] - radius, 0.05)
        u, v = self.intrinsics.project(centre)
        reach_u = self.intrinsics.fx * radius / nearest
        reach_v = self.intrinsics.fy * radius / nearest
        rows = max(0, int(v - reach_v)), min(max(0, int(v + reach_v) + 1), self.depth.shape[0])
        columns = max(0, int(u - reach_u)), min(max(0, int(u + reach_u) + 1), self.depth.shape[1])
        return *rows, *columns


@dataclass(frozen=True)
class RegionCloud:
    """The measured points of one region.

    Attributes:
        points: (n, 3) metres, camera frame.
        normals: (n, 3) unit, toward the camera.
        mask: (H, W) the region's pixels; need not be those of `points` alone.
    """

    points: Array
    normals: Array
    mask: Mask

    @classmethod
    def from_mask(cls, mask: Mask, scene: SceneCloud) -> "RegionCloud":
        """Return the region of the pixels `mask` (H, W), strays left out."""
        rows, columns = _bounds(mask)
        sound = mask[rows, columns] & (scene.depth[rows, columns] > 0)
        sound &= ~scene.stray[rows, columns]
        xyz = scene.xyz[rows, columns]
        normals = smooth_normals(xyz, sound, NORMAL_RADIUS)
        sound &= np.isfinite(normals).all(axis=-1)
        return cls(xyz[sound], normals[sound], np.ascontiguousarray(mask))

    @cached_property
    def middle(self) -> Array:
        """(3,) the median of the points."""
        return median(self.points.T)

    @property
    def view_ray(self) -> Array:
        """Unit direction (3,) from the camera to the region's middle."""
        return unit(self.middle)

    def __getitem__(self, index: NDArray[np.int64]) -> "RegionCloud":
        """Return the same region with some of its points."""
        return replace(self, points=self.points[index], normals=self.normals[index])

    def __len__(self) -> int:
        return len(self.points)


def _bounds(mask: Mask) -> tuple[slice, slice]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _numbers(floor: Plane | None) -> Floor:
    """Return a plane's normal and offset, as compiled loops take them; all is above None."""
    return (0.0, 0.0, 0.0, np.inf) if floor is None else (*floor.normal.tolist(), floor.offset)


@compiled
def _within(points: Array, centre: Array, radius: float, floor: Floor) -> Counts:
    """Return which of `points` (n, 3) lie in a ball and above the floor."""
    found, count = np.empty(len(points), np.int64), 0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        u, v, w = x - centre[0], y - centre[1], z - centre[2]
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
    centre: Array,
    radius: float,
    cell: float,
    floor: Floor,
) -> tuple[Array, Counts, Array, Counts]:
    """Return the first point (n, 3) of each cell of a ball, and how many (n,) lie in it.

    Those above the floor, and those that are not the region's `own` (h, w). Cells are cubes of
    edge `cell`, each twice: for others and for the region. They ascend by x, y and z.
    `image_plane`: x (w,) of columns and y (h,) of rows at depth 1.
    """
    top, bottom, left, right = window
    room, side = max(0, bottom - top) * max(0, right - left), int(2 * radius / cell) + 2
    # Cells at one x and y make a list, from the nearest to the farthest: most are short.
    nearest, behind = np.full(side * side, -1, np.int32), np.empty(room, np.int32)
    level, count = np.empty(room, np.int32), np.empty(room, np.int32)
    points, found, per_metre = np.empty((room, 3)), 0, 1.0 / cell
    last_xy, last = -1, 0  # most pixels show the cell that the one beside them shows
    for i in range(top, bottom):
        for j in range(left, right):
            z = depth[i, j]
            x, y = image_plane[0][j] * z, image_plane[1][i] * z
            u, v, w = x - centre[0], y - centre[1], z - centre[2]
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
    """Return what `_cells_about` does: the lists that start at `nearest` (m,), one by one."""
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
