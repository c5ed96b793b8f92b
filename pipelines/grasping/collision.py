"""Gripper bodies against observed points: collision, enclosed height and clearance (Sec. III-F).

Candidates come as contact pairs times angles about the contact line, so a point's coordinate
along the line is computed once a pair and most points are ruled out before any angle is tried.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.pointcloud import Plane
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import Surroundings

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Counts = NDArray[np.int64]

CHUNK_ELEMENTS = 500_000  # bounds the memory of one pass


@dataclass(frozen=True)
class Sweep:
    """What the gripper meets for k pairs at m angles.

    Attributes:
        inside: (k, m) measured points within the gripper's bodies.
        enclosed: (k, m) metres that scene points reach into the gripper from its tips, 0 for none.
    """

    inside: Counts
    enclosed: Array


def sweep(
    grasps: Grasps, angles: Array, gripper: Gripper, scene: Surroundings, margin: float
) -> Sweep:
    """Turn each of the k `grasps` by each of the m `angles` about its contact line.

    `margin` blows up the bodies, in metres. At angle 0 a grasp is as given; a positive angle
    turns its approach toward approach x closing.
    """
    size = max(1, CHUNK_ELEMENTS // max(1, len(scene.points)))
    parts = [
        _sweep_chunk(grasps[start : start + size], angles, gripper, scene, margin)
        for start in range(0, len(grasps), size)
    ]
    if not parts:
        return Sweep(np.zeros((0, len(angles)), np.int64), np.zeros((0, len(angles))))
    return Sweep(
        np.concatenate([part.inside for part in parts]),
        np.concatenate([part.enclosed for part in parts]),
    )


def _sweep_chunk(
    grasps: Grasps, angles: Array, gripper: Gripper, scene: Surroundings, margin: float
) -> Sweep:
    boxes = gripper.boxes(grasps.width).astype(np.float32)  # (k, 3, 2, 3)
    local = _local(grasps, scene.points)  # (3, k, n)
    along = np.abs(local[1])
    around = np.sqrt(local[0] ** 2 + local[2] ** 2)
    inner = boxes[:, 1, 0, 1] - margin
    outer = boxes[:, 1, 1, 1] + margin
    # To the corners of the blown-up boxes: the margin counts along both edges.
    finger_reach = np.hypot(np.abs(boxes[0, 1, :, 0]).max() + margin, boxes[0, 1, 1, 2] + margin)
    palm_reach = np.hypot(-boxes[0, 2, 0, 0] + margin, boxes[0, 2, 1, 2] + margin)
    palm_front = -boxes[0, 2, 1, 0] - margin
    inside = np.zeros((len(grasps), len(angles)), np.int64)
    at_fingers = (along > inner[:, None]) & (along < outer[:, None]) & (around < finger_reach)
    at_palm = (along < boxes[:, 2, 1, 1][:, None] + margin) & (around < palm_reach)
    at_palm &= around > palm_front
    for near, box in ((at_fingers, boxes[0, 1]), (at_palm, boxes[0, 2])):
        pair, point = np.nonzero(near)
        x, z = _turned(local[0][near], local[2][near], angles)
        hit = (x > box[0, 0] - margin) & (x < box[1, 0] + margin) & (np.abs(z) < box[1, 2] + margin)
        inside += _sums(hit * scene.count[point][:, None], pair, len(grasps))
    enclosed = _enclosed(local, along, around, angles, boxes)
    return Sweep(inside, enclosed)


def _enclosed(
    local: Singles, along: Singles, around: Singles, angles: Array, boxes: Singles
) -> Array:
    """Return (k, m) how far points between the fingers reach in from the tips' line."""
    tip, half = boxes[0, 1, 1, 0], boxes[0, 1, 1, 2]
    back = boxes[0, 1, 0, 0]
    between = (along < boxes[:, 1, 0, 1][:, None]) & (around < np.hypot(back, half))
    pair, _ = np.nonzero(between)
    x, z = _turned(local[0][between], local[2][between], angles)
    height = np.where((np.abs(z) < half) & (x < tip) & (x > back), tip - x, 0.0)
    result = np.zeros((len(boxes), len(angles)))
    if len(pair):
        starts = np.flatnonzero(np.diff(pair, prepend=-1))
        result[pair[starts]] = np.maximum.reduceat(height, starts, axis=0)
    return result


def _local(grasps: Grasps, points: Array) -> Singles:
    """Return (3, k, n) the coordinates of `points` (n, 3) in each grasp's frame.

    Single precision: a micrometre at arm's length, and half the memory to walk through.
    """
    centre = points.mean(axis=0) if len(points) else np.zeros(3)
    axes = grasps.rotation.transpose(2, 0, 1)  # (3, k, 3)
    origin = np.einsum("ki,aki->ak", grasps.translation - centre, axes).astype(np.float32)
    flat = axes.reshape(-1, 3).astype(np.float32) @ (points - centre).T.astype(np.float32)
    return np.asarray(flat.reshape(3, len(grasps), len(points)) - origin[..., None])


def _turned(x: Singles, z: Singles, angles: Array) -> tuple[Singles, Singles]:
    """Return coordinates (n, m) along approach and third axis after turning the hand."""
    cosine, sine = np.cos(angles).astype(np.float32), np.sin(angles).astype(np.float32)
    return x[:, None] * cosine + z[:, None] * sine, z[:, None] * cosine - x[:, None] * sine


def _sums(values: Counts, pair: Counts, num_pairs: int) -> Counts:
    result = np.zeros((num_pairs, values.shape[1]), np.int64)
    if len(pair):
        starts = np.flatnonzero(np.diff(pair, prepend=-1))
        result[pair[starts]] = np.add.reduceat(values, starts, axis=0)
    return result


def turned(grasps: Grasps, pair: Counts, angle: Array) -> Grasps:
    """Return `grasps[pair]`, each turned by its `angle` (n,) about its contact line."""
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


def clearance(grasps: Grasps, gripper: Gripper, points: Array, cap: float) -> Array:
    """Return (n,) the shortest distance from the gripper's bodies to `points`, at most `cap`."""
    result = np.full(len(grasps), cap)
    if not len(points):
        return result
    size = max(1, CHUNK_ELEMENTS // len(points))
    for start in range(0, len(grasps), size):
        part = grasps[start : start + size]
        boxes = gripper.boxes(part.width).astype(np.float32)
        # The hand is its own mirror image across closing and the third axis: one finger stands
        # for both, and only the high sides of the boxes bound there.
        along, across, third = _local(part, points)
        across, third = np.abs(across), np.abs(third)
        nearest = np.full(len(part), cap**2, np.float32)
        for low, high, inner in (
            (boxes[:, 1, 0], boxes[:, 1, 1], boxes[:, 1, 0, 1]),
            (boxes[:, 2, 0], boxes[:, 2, 1], np.zeros(len(part), np.float32)),
        ):
            gap = np.maximum(low[:, 0, None] - along, along - high[:, 0, None])
            squared = np.square(np.maximum(gap, 0, out=gap), out=gap)
            gap = np.maximum(inner[:, None] - across, across - high[:, 1, None])
            squared += np.square(np.maximum(gap, 0, out=gap), out=gap)
            gap = third - high[:, 2, None]
            squared += np.square(np.maximum(gap, 0, out=gap), out=gap)
            np.minimum(nearest, squared.min(axis=1), out=nearest)
        result[start : start + size] = np.sqrt(nearest)
    return result
