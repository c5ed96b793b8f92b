"""Gripper bodies against observed points: collision, enclosed height and clearance (Sec. III-F).

Points come in cubes (`PointCells`): a hand meets few of them, and only their points are looked at
one by one. Most hands that hit something hit so much that a sixteenth of the points tells.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.point_cells import PointCells
from pipelines.geometry.pointcloud import Plane
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]

CELL = 0.02  # metres, of the cubes that points are sorted into
FEW = 16  # every so many-th point is tried first
CHUNK_ELEMENTS = 200_000  # hands times points or cubes of one pass: what fits near the processor


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
    def columns(self) -> Singles:
        """(4, n) about the centre, and ones: a column a point."""
        about = (self.points - self.centre).astype(np.float32)
        return np.concatenate([about.T, np.ones((1, len(about)), np.float32)])

    @cached_property
    def cells(self) -> PointCells:
        """The points in cubes."""
        return PointCells.of(self.points - self.centre, CELL)

    @cached_property
    def fewer(self) -> "Obstacles":
        """Every `FEW`-th of them."""
        return Obstacles(self.points[::FEW], self.count[::FEW])


@dataclass(frozen=True)
class _Bodies:
    """The hand's boxes in its own frame, blown up; it is its own mirror image across closing.

    Numbers but for the bounds along closing, which are (n, ...) as the openings of n hands.
    """

    back: np.float32  # of the fingers along approach
    tip: np.float32
    palm_back: np.float32
    palm_front: np.float32
    half: np.float32  # height of a finger
    palm_half: np.float32
    inner: Singles  # of a finger along closing
    outer: Singles
    palm_outer: Singles

    @classmethod
    def of(cls, gripper: Gripper, width: Array, margin: float = 0.0) -> "_Bodies":
        boxes = gripper.boxes(width).astype(np.float32)  # (n, 3, 2, 3)
        (finger_low, finger_high), (palm_low, palm_high) = gripper.boxes(0.0)[1:].astype(np.float32)
        single = np.float32(margin)
        return cls(
            finger_low[0] - single,
            finger_high[0] + single,
            palm_low[0] - single,
            palm_high[0] + single,
            finger_high[2] + single,
            palm_high[2] + single,
            boxes[..., 1, 0, 1] - single,
            boxes[..., 1, 1, 1] + single,
            boxes[..., 2, 1, 1] + single,
        )

    def by(self, counts: Counts | None) -> "_Bodies":
        """Return the bounds as columns, to face rows of points; or each `counts` times."""
        inner, outer, palm = (
            bound[:, None] if counts is None else np.repeat(bound, counts)
            for bound in (self.inner, self.outer, self.palm_outer)
        )
        scalars = (self.back, self.tip, self.palm_back, self.palm_front, self.half, self.palm_half)
        return _Bodies(*scalars, inner, outer, palm)

    def hits(self, local: Singles) -> Counts:
        """Return (...) how many of the bodies each of the points `local` (3, ...) lies in."""
        along, across, third = local[0], np.abs(local[1]), np.abs(local[2])
        finger = (along > self.back) & (along < self.tip) & (third < self.half)
        finger &= (across > self.inner) & (across < self.outer)
        palm = (along > self.palm_back) & (along < self.palm_front) & (third < self.palm_half)
        palm &= across < self.palm_outer
        return np.asarray(finger.astype(np.int64) + palm)

    def enclosed(self, local: Singles) -> Singles:
        """Return (...) how far from the tips' line points between the fingers reach in."""
        along = local[0]
        between = (along > self.back) & (along < self.tip)
        between &= (np.abs(local[1]) < self.inner) & (np.abs(local[2]) < self.half)
        return np.where(between, self.tip - along, np.float32(0.0))

    def gap(self, local: Singles, *, closed: bool = False) -> Singles:
        """Return (...) the squared distance of points `local` (3, ...) to the nearest body.

        `closed` counts what lies between the fingers as a body, too.
        """
        along, across, third = local[0], np.abs(local[1]), np.abs(local[2])
        inner = np.zeros_like(self.inner) if closed else self.inner
        finger = _squared(self.back - along, along - self.tip)
        finger += _squared(inner - across, across - self.outer)
        finger += _squared(third - self.half)
        palm = _squared(self.palm_back - along, along - self.palm_front)
        palm += _squared(across - self.palm_outer)
        palm += _squared(third - self.palm_half)
        return np.minimum(finger, palm, out=finger)


def _squared(first: Singles, second: Singles | None = None) -> Singles:
    """Return the square of the larger of both, of 0 where both are negative; works in place."""
    if second is not None:
        np.maximum(first, second, out=first)
    np.maximum(first, 0, out=first)
    return np.square(first, out=first)


def meets(
    grasps: Grasps, gripper: Gripper, obstacles: Obstacles, margin: float, allowed: int
) -> tuple[Mask, Array]:
    """Return which of n hands meet more than `allowed` points, and what the others enclose.

    `margin` blows up the bodies, in metres.

    Returns:
        (n,) whether it meets more; (n,) metres that points between the fingers reach into the hand
        from its tips, 0 for none and where it meets more.
    """
    blocked = _meets_any(grasps, gripper, obstacles.fewer, margin, allowed)
    enclosed = np.zeros(len(grasps))
    size = max(1, CHUNK_ELEMENTS // max(1, len(obstacles.cells)))
    free = np.flatnonzero(~blocked)
    for start in range(0, len(free), size):
        chosen = free[start : start + size]
        part = grasps[chosen]
        bodies = _Bodies.of(gripper, part.width, margin)
        cells = obstacles.cells
        away = bodies.by(None).gap(_local(part, cells.centre, obstacles.centre), closed=True)
        counts, places = cells.members(away <= np.square(cells.radius).astype(np.float32))
        local = _local_each(part, obstacles, counts, places)
        hits = bodies.by(counts).hits(local) * obstacles.count[places]
        met = _by_hand(np.add, hits, counts)
        blocked[chosen] = met > allowed
        height = _Bodies.of(gripper, part.width).by(counts).enclosed(local)
        enclosed[chosen] = np.where(met > allowed, 0.0, _by_hand(np.maximum, height, counts))
    return blocked, enclosed


def _meets_any(
    grasps: Grasps, gripper: Gripper, obstacles: Obstacles, margin: float, allowed: int
) -> Mask:
    """Return (n,) which hands meet more than `allowed`, every hand tried against every point."""
    blocked = np.zeros(len(grasps), bool)
    size = max(1, CHUNK_ELEMENTS // max(1, len(obstacles.points)))
    for start in range(0, len(grasps), size):
        part = grasps[start : start + size]
        local = _local(part, obstacles.points - obstacles.centre, obstacles.centre)
        hits = _Bodies.of(gripper, part.width, margin).by(None).hits(local)
        blocked[start : start + size] = hits @ obstacles.count > allowed
    return blocked


def _by_hand(join: np.ufunc, values: NDArray[Any], counts: Counts) -> NDArray[Any]:
    """Return (n,) the sum or the largest of each hand's `counts` (n,) values (sum,), 0 of none."""
    result = np.zeros(len(counts), values.dtype)
    starts = np.cumsum(counts) - counts
    some = counts > 0
    if some.any():
        result[some] = join.reduceat(values, starts[some])
    return result


def clearance(grasps: Grasps, gripper: Gripper, obstacles: Obstacles, cap: float) -> Array:
    """Return (n,) metres from the gripper's bodies to the nearest point, at most `cap`."""
    result = np.full(len(grasps), cap)
    cells = obstacles.cells
    if not len(cells):
        return result
    size = max(1, CHUNK_ELEMENTS // len(cells))
    for start in range(0, len(grasps), size):
        part = grasps[start : start + size]
        bodies = _Bodies.of(gripper, part.width)
        away = np.sqrt(bodies.by(None).gap(_local(part, cells.centre, obstacles.centre)))
        radius = cells.radius.astype(np.float32)
        farthest = np.minimum((away + radius).min(axis=1), np.float32(cap))
        counts, places = cells.members(away - radius <= farthest[:, None])
        gaps = bodies.by(counts).gap(_local_each(part, obstacles, counts, places))
        nearest = -_by_hand(np.maximum, -gaps, counts)
        nearest = np.where(counts > 0, np.minimum(nearest, np.float32(cap**2)), np.float32(cap**2))
        result[start : start + size] = np.sqrt(nearest)
    return result


def _local(grasps: Grasps, points: Array, centre: Array) -> Singles:
    """Return (3, k, n) coordinates in each grasp's frame of `points` (n, 3) about `centre`."""
    axes = grasps.rotation.transpose(2, 0, 1)  # (3, k, 3)
    origin = np.einsum("ki,aki->ak", grasps.translation - centre, axes).astype(np.float32)
    flat = axes.reshape(-1, 3).astype(np.float32) @ points.T.astype(np.float32)
    local: Singles = flat.reshape(3, len(grasps), len(points))
    local -= origin[..., None]
    return local


def _local_each(grasps: Grasps, obstacles: Obstacles, counts: Counts, places: Counts) -> Singles:
    """Return (3, sum) coordinates of points, `counts` (k,) for each grasp, in its frame."""
    origin = np.einsum("ki,kia->ka", grasps.translation - obstacles.centre, grasps.rotation)
    into = np.concatenate([grasps.rotation.transpose(0, 2, 1), -origin[..., None]], -1)
    points = obstacles.columns[:, places]
    local = np.empty((3, len(places)), np.float32)
    ends = np.cumsum(counts).tolist()
    # A product of matrices for each hand: gathering a rotation for each point takes far longer.
    for matrix, start, end in zip(into.astype(np.float32), [0, *ends], ends, strict=False):
        np.matmul(matrix, points[:, start:end], out=local[:, start:end])
    return local


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
