"""What one frame shows: the observed scene, and one region of it. Camera frame, metres."""

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.compiled import compiled
from pipelines.geometry.organized import smooth_normals
from pipelines.geometry.point_cells import first_of_each
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.quantiles import median
from pipelines.geometry.transforms import unit
from pipelines.grasping.collision import Obstacles
from pipelines.grasping.limits import Limits

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_RANGE = 3.0  # metres; nothing farther is ever near a gripper
NORMAL_RADIUS = 3  # pixels
COARSE = 3  # pixels: the step at which the whole scene is an obstacle
NEVER_MET = 0.002  # metres over the table, where no hand comes
STRAY = 0.012  # metres from the median of the neighbours: a pixel between two surfaces


@dataclass(frozen=True)
class Surroundings:
    """The observed points around a region, thinned.

    Attributes:
        points: (n, 3) measured points, one a cell.
        count: (n,) measured points in the cell that each stands for.
        others: those that do not belong to the region.
        centre, radius: (3,), metres; of the ball that they lie in.
    """

    points: Array
    count: NDArray[np.int64]
    others: Obstacles
    centre: Array
    radius: float

    def with_unseen(self, points: Array) -> "Surroundings":
        """Return these and those of `points` (m, 3), known by symmetry alone, that lie in the ball.

        Each counts as one measured point; `others` stay as they are.
        """
        near = points[np.linalg.norm(points - self.centre, axis=1) < self.radius]
        return replace(
            self,
            points=np.concatenate([self.points, near]),
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

    def around(self, region: "RegionCloud", reach: float, resolution: float) -> Surroundings:
        """Return the points within `reach` metres of the region's ball, thinned to `resolution`."""
        low, high = region.points.min(axis=0), region.points.max(axis=0)
        centre, radius = (low + high) / 2.0, float(np.linalg.norm(high - low)) / 2.0 + reach
        window = self._window(centre, radius)
        pixel, key = _in_ball(self.xyz, region.mask, window, centre, radius, resolution)
        first, count = first_of_each(key)
        points, own = _at(self.xyz, region.mask, pixel[first])
        others = np.flatnonzero(~own)
        return Surroundings(points, count, Obstacles(points[others], count[others]), centre, radius)

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


@compiled
def _in_ball(
    xyz: Array,
    own: Mask,
    window: tuple[int, int, int, int],
    centre: Array,
    radius: float,
    cell: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return which pixels (n,) of `xyz` (h, w, 3) show points in a ball, and numbers (n,) of cells.

    Cells are cubes of edge `cell`, each twice: for points of the region `own` (h, w) and others.
    """
    top, bottom, left, right = window
    room = max(0, bottom - top) * max(0, right - left)
    pixel, key = np.empty(room, np.int64), np.empty(room, np.int64)
    side, count = int(2 * radius / cell) + 2, 0
    for row in range(top, bottom):
        for column in range(left, right):
            x = xyz[row, column, 0] - centre[0]
            y = xyz[row, column, 1] - centre[1]
            z = xyz[row, column, 2] - centre[2]
            if x * x + y * y + z * z < radius * radius:  # never where nothing was measured
                at = (int((x + radius) / cell) * side + int((y + radius) / cell)) * side
                key[count] = 2 * (at + int((z + radius) / cell)) + own[row, column]
                pixel[count] = row * own.shape[1] + column
                count += 1
    return pixel[:count].copy(), key[:count].copy()


@compiled
def _at(xyz: Array, own: Mask, pixel: NDArray[np.int64]) -> tuple[Array, Mask]:
    """Return what `xyz` (h, w, 3) and `own` (h, w) are at each `pixel` (n,), row by row."""
    points, mine = np.empty((len(pixel), 3)), np.empty(len(pixel), np.bool_)
    for n in range(len(pixel)):
        row, column = divmod(pixel[n], own.shape[1])
        mine[n] = own[row, column]
        for axis in range(3):
            points[n, axis] = xyz[row, column, axis]
    return points, mine
