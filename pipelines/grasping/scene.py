"""The observed scene as points, and one region of it. Camera frame, metres."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import SensorConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.quantiles import median
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import unit
from pipelines.grasping.limits import Limits
from pipelines.grasping.obstacles import Obstacles
from pipelines.tabletop.levelling import UNKNOWN_UP
from pipelines.tabletop.organized import smooth_normals
from pipelines.tabletop.regions.pieces import box_of

MAX_RANGE = 10.0  # metres; no arm reaches farther
NORMAL_RADIUS = 3  # pixels
STRIDE = 3  # pixels between the obstacles of the whole scene
NEVER_MET = 0.002  # metres over the table that no gripper reaches
STRAY = 0.012  # metres from the neighbours' median, from which a pixel is between surfaces
NEIGHBORS = 5  # pixels, side of the square of these neighbours
FEWEST_MEASURED = 0.05  # of a full column or row; some cameras measure nothing on one side
MOST_MEASURED = 0.8  # of the image's width or height: least extent that a camera measures

Sides = tuple[tuple[int, int], tuple[int, int]]  # first and last column, and row, inclusive


@dataclass(frozen=True)
class SceneCloud:
    """A depth image with its support plane.

    Attributes:
        depth: (H, W) metres, 0 where missing.
        intrinsics: intrinsics of the depth image.
        plane: support plane, camera frame, normal to the camera's side; None if unknown.
        limits: limits of grasps; None without limits.
        sensor: errors of the depth camera.
        objects: (H, W) pixels of the found regions, for methods that grasp in the whole frame;
            None if no regions were sought.
    """

    depth: Array
    intrinsics: Intrinsics
    plane: Plane | None = None
    limits: Limits | None = None
    sensor: SensorConfig = field(default_factory=SensorConfig)
    objects: Mask | None = None

    @cached_property
    def xyz(self) -> Array:
        """(H, W, 3) points, nan where missing."""
        return self.intrinsics.backproject(self.depth)

    @cached_property
    def stray(self) -> Mask:
        """(H, W) stray pixels between two surfaces, which depth sensors produce at edges."""
        depth = np.asarray(self.depth, np.float32)
        return np.asarray(np.abs(cv2.medianBlur(depth, NEIGHBORS) - depth) > STRAY)

    @property
    def near(self) -> Mask:
        """(H, W) pixels with depth below `MAX_RANGE`, without strays."""
        return (self.depth > 0) & (self.depth < MAX_RANGE) & ~self.stray

    @cached_property
    def coarse_obstacles(self) -> Obstacles:
        """The points of every `STRIDE`-th pixel each way, except strays and points on the table."""
        some = (slice(STRIDE // 2, None, STRIDE),) * 2
        points = self.xyz[some][self.near[some]]
        if self.plane is not None:
            points = points[self.plane.height(points) > NEVER_MET]
        return Obstacles(points, np.full(len(points), STRIDE**2))

    @cached_property
    def sides(self) -> Sides:
        """First and last measured column, and row."""
        return measured_sides(self.depth)

    @property
    def up(self) -> Array:
        """Unit direction (3,) away from the table; without a plane that of a usual camera."""
        return UNKNOWN_UP if self.plane is None else self.plane.normal

    @property
    def inward(self) -> Array | None:
        """Unit direction (3,) into the table; None without a plane."""
        return None if self.plane is None else -self.plane.normal


@dataclass(frozen=True)
class RegionCloud:
    """The measured points of one region.

    Attributes:
        points: (n, 3) metres, camera frame.
        normals: (n, 3) unit, toward the camera.
        mask: (H, W) the region's pixels, which may be more than the pixels of `points`.
    """

    points: Array
    normals: Array
    mask: Mask

    @classmethod
    def from_mask(cls, mask: Mask, scene: SceneCloud) -> "RegionCloud":
        """Return the region of the pixels `mask` (H, W), without strays."""
        rows, columns = box_of(mask)
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

    def __getitem__(self, index: Indices) -> "RegionCloud":
        """Return the same region with some of its points."""
        return replace(self, points=self.points[index], normals=self.normals[index])

    def __len__(self) -> int:
        return len(self.points)


def measured_sides(depth: Array) -> Sides:
    """Return the first and the last column, and row, of `depth` (H, W) with enough depth.

    If a much smaller part is measured, as for a cut-out object, the whole image is returned.
    """
    measured, sides = depth > 0.0, []
    for axis in range(2):
        count = np.count_nonzero(measured, axis=axis)
        places = np.flatnonzero(count > FEWEST_MEASURED * count.max(initial=0))
        wide = len(places) and places[-1] - places[0] >= MOST_MEASURED * len(count)
        sides.append((int(places[0]), int(places[-1])) if wide else (0, len(count) - 1))
    return sides[0], sides[1]
