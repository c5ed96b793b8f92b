"""Candidate axes of revolution of a whole surface, from its normals.

The normal line of every point of a surface of revolution meets the axis. For an axis with unit
direction u through c, n . (u x (p - c)) = 0, which is linear in u and m = c x u; so a few points
give an axis without a search. As in RANSAC, small random sets propose axes, all points vote,
and the best axes are fitted to the points that agree: the axis of a body is found in spite of a
handle, and in spite of a missing piece that moves the centroid.
Normalised coordinates: origin at the surface's centroid, unit diameter. Axes are rows
(ux, uy, uz, px, py, pz).
"""

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.transforms import unit
from pipelines.mesh_symmetry.detection.symmetry_candidates import (
    distinct_candidates,
    principal_axis_rows,
)

SET_SIZE = 8  # an axis has four degrees of freedom; normals of scans are rough
NUM_STARTS = 24  # sets with most votes, whose axes are fitted
NUM_FITTED = 600  # points that vote
TOLERANCE = 0.04  # diameters per radian: speed across the surface from which a point disagrees
NUM_REWEIGHTINGS = 6
PRIOR = 1e-3  # weight of the centroid, if the normals do not determine the position of the axis


def revolution_candidates(points: Array, normals: Array, limit: int, min_angle: float) -> Array:
    """Return at most `limit` axes (c, 6), best first, more than `min_angle` radians apart.

    `points`, `normals`: (n, 3) surface samples in random order.
    """
    lines = np.concatenate([np.cross(points, normals), normals], axis=1)  # (n, 6)
    usable = len(lines) // SET_SIZE * SET_SIZE
    sets = lines[:usable].reshape(-1, SET_SIZE, 6)
    voters = lines[:NUM_FITTED]
    proposed = _fitted(np.einsum("ski,skj->sij", sets, sets) / SET_SIZE)
    order = np.argsort(-_votes(voters, proposed).sum(axis=1), kind="stable")[:NUM_STARTS]
    known = np.column_stack([principal_axis_rows(points), np.zeros((3, 3))])
    whole = _fitted((voters.T @ voters)[None] / len(voters))
    axes = np.concatenate([known, whole, proposed[order]])
    for _ in range(NUM_REWEIGHTINGS):
        weight = _votes(voters, axes)
        system = np.einsum("av,vi,vj->aij", weight, voters, voters, optimize=True)
        axes = _fitted(system / weight.sum(axis=1)[:, None, None])
    axes = axes[np.argsort(-_votes(voters, axes).sum(axis=1), kind="stable")]
    keep = distinct_candidates(
        axes[:, :3], np.zeros(len(axes)), limit, min_angle=min_angle, min_offset=np.inf
    )
    directions, moments = axes[keep, :3], axes[keep, 3:]
    return np.concatenate([directions, np.cross(directions, moments)], axis=1)


def _fitted(system: Array) -> Array:
    """Return the axes (a, 6) as (u, m) that solve the normal equations `system` (a, 6, 6)."""
    cross = system[:, :3, 3:]
    inverse = np.linalg.inv(system[:, 3:, 3:] + PRIOR * np.eye(3))
    reduced = system[:, :3, :3] - cross @ inverse @ cross.swapaxes(1, 2)
    direction = np.linalg.eigh(reduced)[1][:, :, 0]
    moment = -np.einsum("aij,akj,ak->ai", inverse, cross, direction)
    along = np.einsum("ai,ai->a", moment, direction)  # the pitch of a screw, which is removed
    return np.concatenate([unit(direction), moment - along[:, None] * direction], axis=1)


def _votes(lines: Array, axes: Array) -> Array:
    """Return the agreement (a, n) of each of the `lines` (n, 6) with each axis, 0 to 1."""
    speed = axes @ lines.T
    return np.asarray(1.0 / (1.0 + np.square(speed / TOLERANCE)))
