"""Gripper bodies against observed points: collision, enclosed height and clearance (Sec. III-F).

Points come in cubes (`PointCells`): a hand meets few of them, and only their points are looked at
one by one, and only until it is known to hit too much.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.point_cells import PointCells
from pipelines.geometry.pointcloud import Plane
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.hand_bodies import nearest_gaps, points_met

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
    def centre(self) -> Array:
        """(3,) their middle: single precision is a micrometre at arm's length, less near it."""
        return self.points.mean(axis=0) if len(self.points) else np.zeros(3)

    @cached_property
    def cells(self) -> tuple[Singles, Counts, Counts, Singles, Singles]:
        """The points in cubes about the centre, as compiled loops take them (`points_met`)."""
        cells = PointCells.of(self.points - self.centre, CELL)
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
    blocked, enclosed = points_met(frames, bounds, np.float32(margin), allowed, *obstacles.cells)
    return blocked, enclosed.astype(np.float64)


def clearance(grasps: Grasps, gripper: Gripper, obstacles: Obstacles, cap: float) -> Array:
    """Return (n,) metres from the gripper's bodies to the nearest point, at most `cap`."""
    frames, bounds = _hands(grasps, gripper, obstacles)
    gaps = nearest_gaps(frames, bounds, np.float32(cap), *obstacles.cells)
    return np.asarray(np.minimum(gaps.astype(np.float64), cap))


def _hands(grasps: Grasps, gripper: Gripper, obstacles: Obstacles) -> tuple[Singles, Singles]:
    """Return (n, 3, 4) matrices into each hand's frame, about the obstacles, and (n, 9) bounds.

    The hand is its own mirror image across closing and height. In order: the fingers' back and tip
    along approach, the palm's back and front, half the fingers' and the palm's height, the inner
    and outer face of a finger and the side of the palm along closing.
    """
    origin = np.einsum("ki,kia->ka", grasps.translation - obstacles.centre, grasps.rotation)
    frames = np.concatenate([grasps.rotation.transpose(0, 2, 1), -origin[..., None]], -1)
    boxes = gripper.boxes(grasps.width)  # (n, 3, 2, 3)
    finger, palm = boxes[:, 1], boxes[:, 2]
    bounds = [finger[:, 0, 0], finger[:, 1, 0], palm[:, 0, 0], palm[:, 1, 0], finger[:, 1, 2]]
    bounds += [palm[:, 1, 2], finger[:, 0, 1], finger[:, 1, 1], palm[:, 1, 1]]
    return frames.astype(np.float32, order="C"), np.stack(bounds, axis=1).astype(np.float32)


def turned(grasps: Grasps, pair: Counts, angle: Array) -> Grasps:
    """Return `grasps[pair]`, each turned by its `angle` (n,) about its contact line.

    At angle 0 a grasp is as given; a positive angle turns its approach toward approach x closing.
    """
    R = grasps.rotation[pair]
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    approach, third = R[:, :, 0], R[:, :, 2]
    rotation = np.stack([c * approach + s * third, R[:, :, 1], c * third - s * approach], -1)
    return Grasps(rotation, grasps.translation[pair], grasps.width[pair])


def lowest_height(grasps: Grasps, gripper: Gripper, plane: Plane) -> Array:
    """Return (n,) the height of the gripper's lowest corner over `plane`, negative below it."""
    boxes = gripper.boxes(grasps.width)  # (n, 3, 2, 3)
    normal = np.einsum("i,nij->nj", plane.normal, grasps.rotation)[:, None, None]
    lowest = (boxes * normal).min(axis=2).sum(axis=-1).min(axis=1)
    return np.asarray(plane.height(grasps.translation) + lowest)
