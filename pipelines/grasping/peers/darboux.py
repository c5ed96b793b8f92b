"""Grasp candidates of PointNetGPD: a hand at each sampled point, in the surface's Darboux frame.

The candidates follow the adaptation in GraspNet-1Billion's benchmark. Camera frame, metres.
"""

import numpy as np
from scipy.spatial import cKDTree

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import cross
from pipelines.grasping.peers.hands import Hands, free_hands

MIN_HEIGHT, MAX_HEIGHT = 0.006, 0.5  # metres over the table: lower is table, higher no object
NORMAL_NEIGHBORS, FRAME_NEIGHBORS = 10, 40
RADIUS = 0.01  # metres, radius of the neighbours for a normal and for a frame
DEPTH = 0.02  # metres from a candidate's point to its finger tips


def over_table(points: Array, table: Plane | None) -> Array:
    """Return the `points` (n, 3) at heights of objects; all points without a table."""
    if table is None:
        return points
    height = table.height(points)
    return points[(height > MIN_HEIGHT) & (height < MAX_HEIGHT)]


def outward_normals(points: Array) -> Array:
    """Return unit normals (n, 3) of a thinned cloud, toward the camera."""
    index, there = _near(points, points, NORMAL_NEIGHBORS)
    about = np.where(there[..., None], points[index], 0.0)
    mean = about.sum(axis=1) / there.sum(axis=1)[:, None]  # each point is its own neighbour
    centered = np.where(there[..., None], about - mean[:, None], 0.0)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", centered, centered))[1][..., 0]
    away = np.einsum("ni,ni->n", normals, points) > 0
    return np.where(away[:, None], -normals, normals)


def darboux_frames(at: Array, points: Array, normals: Array) -> Array:
    """Return the frames (m, 3, 3) of the surface at the points `at` (m, 3).

    The approach is opposite to the normal; the binormal is the direction in which the normal
    changes least, as along the axis of a cylinder.

    Args:
        at: points on the surface.
        points: (n, 3) points of the surface.
        normals: (n, 3) outward normals of `points`.
    """
    index, there = _near(at, points, FRAME_NEIGHBORS)
    near = np.where(there[..., None], normals[index], 0.0)
    axes = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))[1]
    inward = np.einsum("ni,ni->n", axes[..., 2], near.sum(axis=1)) < 0
    approach = np.where(inward[:, None], axes[..., 2], -axes[..., 2])
    binormal = axes[..., 0]
    return np.stack([approach, cross(binormal, approach), binormal], axis=-1)


def candidate_hands(objects: Array, scene: Array, count: int, rng: np.random.Generator) -> Hands:
    """Return hands at up to `count` random points of `objects` without collision with `scene`.

    `objects` and `scene`: (n, 3) and (m, 3), thinned.
    """
    if not len(objects):
        return Hands.none()
    at = objects[rng.permutation(len(objects))[:count]]
    frames = darboux_frames(at, objects, outward_normals(objects))
    hands = Hands.equally_open(frames, at, np.full(len(at), DEPTH))
    return hands[free_hands(hands, objects, scene)]


def _near(at: Array, points: Array, count: int) -> tuple[Indices, Mask]:
    """Return indices (m, k) of up to `count` `points` near each of `at` (m, 3), and a mask."""
    ranks = range(1, min(count, len(points)) + 1)
    away, index = cKDTree(points).query(at, ranks, distance_upper_bound=RADIUS)
    there = np.isfinite(away)
    return np.where(there, index, 0), there
