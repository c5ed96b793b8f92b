"""Gripper bodies against observed points: collision, enclosed height and clearance (Sec. III-F).

Points come in cubes (`PointCells`): a hand meets few of them, and only their points are looked at
one by one, and only until it is known to hit too much.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.point_cells import PointCells
from pipelines.geometry.pointcloud import Plane
from pipelines.grasping.feasibility.gripper_bodies import (
    Cells,
    frames_about,
    free_hands,
    nearest_gaps,
    points_met,
)
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]

CELL = 0.02  # metres, of the cubes that points are sorted into


@dataclass(frozen=True)
class Obstacles:
    """Points (n, 3) that a hand may meet, each standing for `count` (n,) measured ones."""

    points: Array
    count: Counts

    @cached_property
    def _about(self) -> tuple[Array, Array]:
        """(3,) the points' middle, (n, 3) the points about it."""
        return _about_middle(self.points)

    @property
    def centre(self) -> Array:
        """(3,) their middle: single precision is a micrometre at arm's length, less near it."""
        return self._about[0]

    @cached_property
    def cells(self) -> Cells:
        """The points in cubes about the centre, as compiled loops take them (`hand_bodies`)."""
        cells = PointCells.of(self._about[1], CELL)
        return cells.points, self.count[cells.index], cells.start, cells.centre, cells.radius


def meets(
    grasps: Grasps, gripper: Gripper, obstacles: Obstacles, margin: float, allowed: int
) -> tuple[Mask, Array]:
    """Return which of n hands meet more than `allowed` points, and what the others enclose.

    `margin` blows up the bodies, in metres.

    Returns:
        (n,) whether it meets more; (n,) metres that points between the fingers reach into the hand
        from its tips, 0 for none and where it meets more.
    """
    frames, bounds = _hands(grasps, gripper, obstacles)
    blocked, enclosed = points_met(frames, bounds, np.float32(margin), allowed, obstacles.cells)
    return blocked, enclosed.astype(np.float64)


def first_free(
    grasps: Grasps,
    gripper: Gripper,
    obstacles: Obstacles,
    config: SelectionConfig,
    steady: Array,
    share: float,
    most: int,
) -> tuple[Counts, Array]:
    """Return which of n hands (f,) are free, and the metres (f,) that they enclose, as `meets`.

    Hands come steadiest first, `steady` (n,). At most `most` are wanted, as steady as `share` of
    the first of them: what comes after these is not looked at.
    """
    frames, bounds = _hands(grasps, gripper, obstacles)
    blown, few = np.float32(config.body_margin), config.max_points_inside
    wanted = (config.min_enclosed, share, most)
    free, enclosed = free_hands(frames, bounds, blown, few, obstacles.cells, steady, wanted)
    return free, enclosed.astype(np.float64)


def clearance(grasps: Grasps, gripper: Gripper, obstacles: Obstacles, cap: float) -> Array:
    """Return (n,) metres from the gripper's bodies to the nearest point, at most `cap`."""
    frames, bounds = _hands(grasps, gripper, obstacles)
    gaps = nearest_gaps(frames, bounds, np.float32(cap), obstacles.cells)
    return np.asarray(np.minimum(gaps.astype(np.float64), cap))


def _hands(grasps: Grasps, gripper: Gripper, obstacles: Obstacles) -> tuple[Singles, Singles]:
    """Return (n, 3, 4) matrices into each hand's frame, about the obstacles, and (n, 9) bounds."""
    rotation, translation = map(np.ascontiguousarray, (grasps.rotation, grasps.translation))
    frames = frames_about(rotation, translation, obstacles.centre)
    return frames, gripper.bounds(grasps.width).astype(np.float32)


def turned(grasps: Grasps, pair: Counts, angle: Array) -> Grasps:
    """Return `grasps[pair]`, each turned by its `angle` (n,) about its contact line.

    At angle 0 a grasp is as given; a positive angle turns its approach toward approach x closing.
    """
    R = grasps.rotation[pair]
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    approach, third = R[:, :, 0], R[:, :, 2]
    rotation = R.copy()
    rotation[:, :, 0], rotation[:, :, 2] = c * approach + s * third, c * third - s * approach
    return Grasps.unchecked(rotation, grasps.translation[pair], grasps.width[pair])


def lowest_height(grasps: Grasps, gripper: Gripper, plane: Plane) -> Array:
    """Return (n,) the height of the gripper's lowest corner over `plane`, negative below it."""
    back, tip, palm_back, front, half, palm_half, _, outer, side = gripper.bounds(grasps.width).T
    along, across, third = np.einsum("i,nij->jn", plane.normal, grasps.rotation)
    across, third = np.abs(across), np.abs(third)
    fingers = np.minimum(back * along, tip * along) - outer * across - half * third
    palm = np.minimum(palm_back * along, front * along) - side * across - palm_half * third
    return np.asarray(plane.height(grasps.translation) + np.minimum(fingers, palm))


@compiled
def _about_middle(points: Array) -> tuple[Array, Array]:
    """Return (3,) the mean of `points` (n, 3), zeros of none, and (n, 3) the points less it."""
    x, y, z, count = 0.0, 0.0, 0.0, max(len(points), 1)
    for n in range(len(points)):
        x, y, z = x + points[n, 0], y + points[n, 1], z + points[n, 2]
    x, y, z = x / count, y / count, z / count
    about = np.empty((len(points), 3))
    for n in range(len(points)):
        about[n, 0], about[n, 1], about[n, 2] = points[n, 0] - x, points[n, 1] - y, points[n, 2] - z
    return np.array((x, y, z)), about
