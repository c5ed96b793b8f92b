"""Symmetries of a region from its points' predictions: SymmetryNet's aggregation, Sec. IV-E."""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ROTATION_SLOT,
    SPHERE_SLOT,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
    SymmetrySlots,
)
from pipelines.geometry.transforms import unit
from pipelines.grasping.scene import SceneCloud

NEAR, NEEDED = 0.2, 0.5  # of a unit vector's coordinate; share of the points near a core
TRIALS = 256  # lines through two feet each
INLIER = 0.015  # metres from a foot to the axis, from a vote to the centre
IN_FRONT = 0.01  # metres in front of the seen surface, where an image would be visible
SHORTEST = 1e-6  # metres, least length of an offset with a direction
PLANE, AXIS, BOTH, SPHERE = range(4)  # modes


@dataclass(frozen=True)
class SymmetryOffsets:
    """Predictions of n points of a region; offsets are from the point, metres, camera frame.

    Attributes:
        points: (n, 3).
        center: (n, 3) offsets to the centre.
        mirrored: (n, 3, 3) offsets to the point's images across three planes.
        axis_foot: (n, 3) offsets to the point's foot on the axis.
        existence: (n, 3) probabilities of the planes.
        mode: (4,) probabilities of planes alone, of an axis alone, of both, and of a sphere.
    """

    points: Array
    center: Array
    mirrored: Array
    axis_foot: Array
    existence: Array
    mode: Array


def symmetries_by_offsets(predicted: SymmetryOffsets, scene: SceneCloud) -> SymmetrySlots:
    """Return the planes, the axis and the sphere that the points agree on.

    Confidence is the predicted probability times the share of the points that agree; for planes
    and the axis, also times the share of the points with images that are not refuted.
    """
    middle = (predicted.points + predicted.center).mean(axis=0)
    found: list[tuple[int, Symmetry, float]] = []
    for slot in REFLECTION_SLOTS:
        normal, share = _common_direction(predicted.mirrored[:, slot])
        plane = ReflectionSymmetry(normal, middle)
        seen = share * unrefuted(plane.counterpart(predicted.points), scene)
        found.append((slot, plane, seen * float(predicted.existence[:, slot].mean())))
    axis, share = _line_through(predicted.points + predicted.axis_foot)
    seen = share * unrefuted(axis.counterpart(predicted.points), scene)
    found.append((ROTATION_SLOT, axis, seen * float(predicted.mode[AXIS] + predicted.mode[BOTH])))
    votes = predicted.points + predicted.center
    center = np.median(votes, axis=0)
    share = float((np.linalg.norm(votes - center, axis=1) < INLIER).mean())
    found.append((SPHERE_SLOT, SphereSymmetry(center), share * float(predicted.mode[SPHERE])))
    return SymmetrySlots.of(found, "network")


def unrefuted(points: Array, scene: SceneCloud) -> float:
    """Return the share of `points` (n, 3) that are not in front of the seen surface."""
    pixels, inside = scene.intrinsics.pixels_of(points)
    columns, rows = pixels[inside].T
    depth = scene.depth[rows, columns]
    in_front = (depth > 0) & (points[inside, 2] < depth - IN_FRONT)
    return 1.0 - float(in_front.sum()) / len(points)


def _common_direction(offsets: Array) -> tuple[Array, float]:
    """Return the common unit direction of offsets (n, 3) of either sign, and the agreeing share.

    Each coordinate is from the largest cluster by DBSCAN, or the median without a cluster.
    """
    lengths = np.linalg.norm(offsets, axis=1, keepdims=True)
    directions = offsets / np.maximum(lengths, SHORTEST)
    main = np.linalg.eigh(directions.T @ directions)[1][:, 2]
    directions = np.where((directions @ main)[:, None] < 0.0, -directions, directions)
    common, agree = np.zeros(3), np.ones(len(offsets), bool)
    for i, values in enumerate(directions.T):
        members = _cluster(values)
        agree &= members
        common[i] = values[members].mean() if members.any() else np.median(values)
    if np.linalg.norm(common) < NEAR:
        return main, 0.0
    return unit(common), float(agree.mean())


def _cluster(values: Array) -> Mask:
    """Return a mask of `values` (n,) in the largest cluster of DBSCAN with NEAR and NEEDED."""
    ordered = np.sort(values)
    last = np.searchsorted(ordered, ordered + NEAR, "right")
    core = ordered[last - np.searchsorted(ordered, ordered - NEAR) >= NEEDED * len(values)]
    if not len(core):
        return np.zeros(len(values), bool)
    groups = np.split(core, np.flatnonzero(np.diff(core) > NEAR) + 1)
    largest = max(groups, key=len)
    return np.asarray((values >= largest[0] - NEAR) & (values <= largest[-1] + NEAR))


def _line_through(feet: Array) -> tuple[RotationSymmetry, float]:
    """Return the line through most of `feet` (n, 3), by RANSAC, and the share of its inliers."""
    rng = np.random.default_rng(0)
    first, second = feet[rng.integers(len(feet), size=(2, TRIALS))]
    along = second - first
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / np.maximum(lengths, SHORTEST)
    near = _distances(feet, first, along) < INLIER  # (TRIALS, n)
    near[lengths[:, 0] < SHORTEST] = False
    best = feet[near[near.sum(axis=1).argmax()]]
    best = best if len(best) else feet
    middle = best.mean(axis=0)
    direction = np.linalg.svd(best - middle, full_matrices=False)[2][0]
    share = (_distances(feet, middle[None], direction[None])[0] < INLIER).mean()
    return RotationSymmetry(direction, middle), float(share)


def _distances(points: Array, on_line: Array, along: Array) -> Array:
    """Return the distances (k, n) of `points` (n, 3) from k lines."""
    offset = points - on_line[:, None]
    return np.asarray(np.linalg.norm(np.cross(offset, along[:, None]), axis=-1))
