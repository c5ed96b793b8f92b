"""Axes of revolution of parts of a surface, each proposed by a patch of its samples.

On a surface of revolution the line of every normal meets the axis: the normal does not lean
sideways. This condition is linear in the Pluecker coordinates of the axis, so a patch gives an axis
by one eigenvalue problem.
Normalised coordinates: origin at the surface's centroid, unit diameter.
"""

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.mesh_symmetry.surface.cylinder_profile import (
    MAX_LEAN,
    MIN_COUNT,
    Axis,
    profile,
    support,
)

NUM_PATCHES = 32  # at least, of each radius
PATCH_RADII = (0.08, 0.16, 0.32, 2.0)  # of the diameter; the last covers the whole surface
PATCH_SAMPLES = 1300  # at least, in all patches
KEPT_AXES = 5  # the most
SAME_LINE_ANGLE, SAME_LINE_OFFSET = float(np.radians(6.0)), 0.03  # radians, of the diameter
# Of the moments' scale: keeps the motions solvable that a surface does not determine, such as the
# shift along a cylinder.
DAMPING = 1e-5
THINNEST = 1e-9  # of the diameter or of a moment, instead of zero
LEAN_SCALES = (0.5, 0.35, 0.25)  # Tukey scales of the normals' sideways lean, per step of the fit


def revolution_axes(points: Array, normals: Array) -> list[Axis]:
    """Return the axes of revolution of patches of the surface, by falling support.

    `points`, `normals`: (n, 3) samples, evenly spread.
    """
    p, n = (strided_at_least(each, PATCH_SAMPLES) for each in (points, normals))
    centers = strided_at_least(p, NUM_PATCHES)
    distance = np.linalg.norm(centers[:, None] - p[None], axis=2)
    members = np.concatenate([distance < radius for radius in PATCH_RADII])
    directions, feet = _fitted(p, n, members.astype(np.float64))
    for limit in LEAN_SCALES:
        lean = _leans(p, n, directions, feet) / limit
        directions, feet = _fitted(p, n, np.where(np.abs(lean) < 1.0, (1.0 - lean**2) ** 2, 0.0))
    lateral = np.linalg.norm(np.cross(n[None], directions[:, None]), axis=2)
    explained = np.abs(_leans(p, n, directions, feet)) < MAX_LEAN
    order = np.argsort(-(lateral * explained).sum(axis=1), kind="stable")
    kept: list[Axis] = []
    for index in order:
        axis = Axis(directions[index], feet[index])
        if len(kept) < KEPT_AXES and not any(same_line(axis, better) for better in kept):
            kept.append(axis)
    return kept


def refined(axis: Axis, points: Array, normals: Array) -> tuple[Axis, Mask]:
    """Return `axis` fitted to the samples that support it, and the mask (n,) of these samples.

    `points`, `normals`: (n, 3) samples.
    """
    held = support(profile(axis, points, normals))
    for _ in range(3):
        if held.sum() < MIN_COUNT:
            break
        directions, feet = _fitted(points, normals, held[None].astype(np.float64))
        axis = Axis(directions[0], feet[0])
        held = support(profile(axis, points, normals))
    return axis, held


def _fitted(points: Array, normals: Array, weights: Array) -> tuple[Array, Array]:
    """Return direction (k, 3) and point (k, 3) of the best axis for each row of `weights` (k, n).

    A turn w about a point moves x by v + w cross x; on a surface of revolution this motion is
    tangential: n.v + w.(x cross n) = 0. The smallest eigenvector for unit w is the axis; the part
    of v along w is the pitch of a screw, which a cylinder does not determine.
    """
    rows = np.concatenate([np.cross(points, normals), normals], axis=1)
    moment = (weights @ (rows[:, :, None] * rows[:, None, :]).reshape(len(rows), 36)).reshape(
        -1, 6, 6
    )
    turning, mixed, moving = moment[:, :3, :3], moment[:, :3, 3:], moment[:, 3:, 3:]
    scale = np.trace(moving, axis1=1, axis2=2)[:, None, None] + THINNEST
    back = np.linalg.solve(moving + DAMPING * scale * np.eye(3), mixed.swapaxes(1, 2))
    directions = np.linalg.eigh(turning - mixed @ back)[1][:, :, 0]
    velocity = -np.einsum("kij,kj->ki", back, directions)
    return directions, np.cross(directions, velocity)


def _leans(points: Array, normals: Array, directions: Array, feet: Array) -> Array:
    """Return the sines (k, n) between each normal and the plane through axis and sample."""
    sideways = np.cross(directions[:, None], points[None] - feet[:, None])
    radius = np.linalg.norm(sideways, axis=2)
    return np.asarray(np.einsum("nd,knd->kn", normals, sideways) / np.maximum(radius, THINNEST))


def same_line(first: Axis, second: Axis) -> bool:
    """Return whether two axes are nearly the same line."""
    if abs(first.direction @ second.direction) < np.cos(SAME_LINE_ANGLE):
        return False
    between = np.cross(first.point - second.point, second.direction)
    return float(np.linalg.norm(between)) < SAME_LINE_OFFSET
