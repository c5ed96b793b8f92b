"""Axes of revolution of parts of a surface, and the samples that each axis explains.

On a surface of revolution the line of every normal meets the axis: the normal does not lean
sideways. This condition is linear in the Pluecker coordinates of the axis, so a patch gives an axis
by one eigenvalue problem. A sample supports the axis only if its circle is full: if samples of the
same height, radius and slope surround the axis.
Normalised coordinates: origin at the surface's centroid, unit diameter.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.transforms import basis_from_direction

NUM_PATCHES = 32
PATCH_RADII = (0.08, 0.16, 0.32, 2.0)  # of the diameter; the last covers the whole surface
PATCH_SAMPLES = 1300
KEPT_AXES = 5
SAME_ANGLE, SAME_OFFSET = float(np.radians(6.0)), 0.03
LEAN_SCALES = (0.5, 0.35, 0.25)  # Tukey scales of the normals' sideways lean, per step of the fit

MAX_LEAN = float(np.sin(np.radians(20.0)))  # a hexagon's sides lean by up to 30 degrees
NEAR_AXIS = 0.012  # of the diameter; closer to the axis, the lean of a normal is meaningless
CIRCLE_CELL = 0.025  # of the diameter; cell of height and radius of a circle
SLOPE_SECTORS = 6  # cells of the slope of a circle's surface
BINS = 24  # of the angle around the axis
MIN_COVERAGE = 0.5  # of a circle's bins; scattered samples fill 0.8 of a full circle, 0.4 of half
MIN_COUNT = 12  # fewer samples do not show whether a circle is full
MANY = 72  # least samples to count single bins; with fewer, pairs of bins
MAX_HARMONIC = 0.1  # radians; a regular n-gon leans by 2 / n, an ellipse by 1 - its flattening
HIGHEST_HARMONIC = 12


@dataclass(frozen=True)
class Axis:
    """A line: unit `direction` (3,) through `point` (3,)."""

    direction: Array
    point: Array


@dataclass(frozen=True)
class Profile:
    """Samples and their normals in cylinder coordinates about an axis, all (n,)."""

    height: Array
    radius: Array
    angle: Array  # radians
    lean: Array  # sine between the outward normal and the plane through axis and sample
    slope: Array  # radians, direction of the normal in this plane, equal for both signs
    lateral: Array  # sine between normal and axis: 0 for a flat across the axis


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
    """Return `axis` fitted to the samples that support it, and the mask (n,) of these samples."""
    held = support(profile(axis, points, normals))
    for _ in range(3):
        if held.sum() < MIN_COUNT:
            break
        directions, feet = _fitted(points, normals, held[None].astype(np.float64))
        axis = Axis(directions[0], feet[0])
        held = support(profile(axis, points, normals))
    return axis, held


def profile(axis: Axis, points: Array, normals: Array) -> Profile:
    """Return `points` with their `normals`, both (n, 3), in cylinder coordinates about `axis`."""
    arm = points - axis.point
    height = arm @ axis.direction
    across = arm - height[:, None] * axis.direction
    radius = np.linalg.norm(across, axis=1)
    outward = across / np.maximum(radius, 1e-12)[:, None]
    # Angles start at the first sample, so that they turn with the surface.
    start = outward[0] if radius[0] > 1e-9 else basis_from_direction(axis.direction)[:, 1]
    side = np.cross(axis.direction, start)
    along, away = normals @ axis.direction, np.einsum("nd,nd->n", normals, outward)
    lean = np.einsum("nd,nd->n", normals, np.cross(axis.direction, outward))
    return Profile(
        height=height - height[0],
        radius=radius,
        angle=np.arctan2(across @ side, across @ start),
        lean=np.where(away < 0.0, -lean, lean),  # some meshes have inverted triangles
        slope=np.arctan2(along, away) % np.pi,
        lateral=np.sqrt(np.clip(1.0 - along**2, 0.0, 1.0)),
    )


def support(p: Profile) -> Mask:
    """Return the mask (n,) of the samples on full, round circles of the surface."""
    upright = (np.abs(p.lean) < MAX_LEAN) | (p.radius < NEAR_AXIS)
    held = np.zeros(len(p.height), dtype=np.bool_)
    sector = np.pi / SLOPE_SECTORS
    index = np.flatnonzero(upright)
    for shift in (0.0, 0.5):  # so that no cell border hides a circle
        number = _numbered(
            np.floor(p.height[index] / CIRCLE_CELL + shift),
            np.floor(p.radius[index] / CIRCLE_CELL + shift),
            np.floor(p.slope[index] / sector + shift) % SLOPE_SECTORS,
        )
        good = _full_circles(number, p.angle[index]) & _round_circles(
            number, p.angle[index], p.lean[index]
        )
        held[index] |= good[number]
    return held


def _numbered(*columns: Array) -> Indices:
    """Return numbers (n,) from 0 for the distinct rows of integer `columns` (n,)."""
    key = np.zeros(len(columns[0]), dtype=np.int64)
    for column in columns:
        whole = column.astype(np.int64) - int(column.min(initial=0.0))
        key = key * (int(whole.max(initial=0)) + 1) + whole
    return np.unique(key, return_inverse=True)[1].reshape(-1)


def _round_circles(number: Indices, angle: Array, lean: Array) -> Mask:
    """Return the mask (c,) of the cells whose normals lean without a regular pattern.

    The normals of an n-gon, or of an ellipse (n = 2), lean to and fro n times around the axis; the
    normals of a circle off the axis, as of a bent tube, lean once.
    """
    count = np.maximum(np.bincount(number), 1)
    spread = np.sqrt(np.bincount(number, weights=lean**2) / count)
    worst = np.zeros(len(count))
    turn = np.exp(1j * angle)
    wave = lean.astype(np.complex128)
    for _ in range(HIGHEST_HARMONIC):
        wave = wave * turn
        parts = (np.bincount(number, weights=part) for part in (wave.real, wave.imag))
        worst = np.maximum(worst, 2.0 * np.hypot(*parts) / count)
    # The second term is the amplitude of scattered normals by chance.
    return np.asarray(worst < MAX_HARMONIC + 2.0 * spread * np.sqrt(2.0 / count))


def _full_circles(number: Indices, angle: Array) -> Mask:
    """Return the mask (c,) of the cells with a full circle; `number`: (n,) cell of each sample."""
    count = int(number.max(initial=-1)) + 1
    bins = np.minimum(((angle + np.pi) / (2.0 * np.pi) * BINS).astype(np.int64), BINS - 1)
    fine = np.bincount(number * BINS + bins, minlength=count * BINS).reshape(count, BINS)
    coarse = fine.reshape(count, BINS // 2, 2).sum(axis=2)
    total = fine.sum(axis=1)
    coverage = np.where(total < MANY, _filled(coarse), _filled(fine))
    return np.asarray((coverage >= MIN_COVERAGE) & (total >= MIN_COUNT))


def _filled(bins: Indices) -> Array:
    """Return how full each row of `bins` (c, k) is (c,), relative to its median non-empty bin."""
    ranked = np.sort(bins, axis=1)
    empty = (bins == 0).sum(axis=1)
    middle = np.minimum(empty + (bins.shape[1] - empty) // 2, bins.shape[1] - 1)
    usual = np.maximum(np.take_along_axis(ranked, middle[:, None], axis=1), 1)
    return np.asarray(np.minimum(bins / usual, 1.0).mean(axis=1))


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
    scale = np.trace(moving, axis1=1, axis2=2)[:, None, None] + 1e-9
    back = np.linalg.solve(moving + 1e-5 * scale * np.eye(3), mixed.swapaxes(1, 2))
    directions = np.linalg.eigh(turning - mixed @ back)[1][:, :, 0]
    velocity = -np.einsum("kij,kj->ki", back, directions)
    return directions, np.cross(directions, velocity)


def _leans(points: Array, normals: Array, directions: Array, feet: Array) -> Array:
    """Return the sines (k, n) between each normal and the plane through axis and sample."""
    sideways = np.cross(directions[:, None], points[None] - feet[:, None])
    radius = np.linalg.norm(sideways, axis=2)
    return np.asarray(np.einsum("nd,knd->kn", normals, sideways) / np.maximum(radius, 1e-9))


def same_line(first: Axis, second: Axis) -> bool:
    """Return whether two axes are nearly the same line."""
    if abs(first.direction @ second.direction) < np.cos(SAME_ANGLE):
        return False
    between = np.cross(first.point - second.point, second.direction)
    return float(np.linalg.norm(between)) < SAME_OFFSET
