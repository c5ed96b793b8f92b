"""A surface in cylinder coordinates about an axis, and its full, round circles.

A sample supports an axis of revolution only if its circle is full: if samples of the same height,
radius and slope surround the axis. The normals of round circles do not lean sideways.
Normalised coordinates: origin at the surface's centroid, unit diameter.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.transforms import basis_from_direction

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
