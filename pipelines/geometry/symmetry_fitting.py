"""Fit a predicted symmetry to the points that one view shows.

A network sees a symmetry roughly; the measured surface says it exactly. A rotation axis meets the
normal line of every point of the surface that it turns. A mirror image must lie on the surface
where that is seen. Both are fitted by a few robust Gauss-Newton steps from the prediction, which
stays as a prior: what one view cannot show must not run away.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.numerics.fitting_sums import (
    SCALES,
    Sums,
    axis_sums,
    fitted_sphere,
    mirrored,
    plane_sums,
    stepped,
)
from pipelines.geometry.numerics.nearest import Neighbours
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.transforms import basis_from_direction, cross, unit

STEPS = 5  # more lead nowhere better; a plane's cost most, its images look for their neighbours
EVERY = 4  # so many-th point is mirrored, onto all
NOISE = 0.003  # metres, standard deviation of a residual that fits
PRIOR_ANGLE = np.radians(20.0)  # standard deviation of a prediction
PRIOR_OFFSET = 0.015  # metres
PRECISION = np.array([PRIOR_ANGLE, PRIOR_ANGLE, PRIOR_OFFSET, PRIOR_OFFSET]) ** -2.0
STEP_SCALES = np.geomspace(*SCALES, STEPS)
# Neighbouring points err together: a region of any size says as much as this many points.
EFFECTIVE_POINTS = 60
MIN_OVERLAP = 0.25  # share of mirrored points that must meet seen surface, else nothing is known


@dataclass(frozen=True)
class Fit:
    """A fitted direction and point, and how well they explain the surface: 0 not, 1 all of it."""

    direction: Array
    point: Array
    support: float


# Of k directions, points and bases (k, 3, 2), and a scale in metres.
Linearised = Callable[[Array, Array, Array, float], Sums]


def fit_rotations(starts: Sequence[RotationSymmetry], points: Array, normals: Array) -> list[Fit]:
    """Fit each of some axes to `points` and `normals` (n, 3) of a surface, metres, any frame."""
    rows = np.concatenate([cross(points, normals), normals], axis=1)
    squares = (rows[:, :, None] * rows[:, None, :]).reshape(-1, 36)

    def linearised(axis: Array, centre: Array, basis: Array, scale: float) -> Sums:
        return axis_sums(rows, squares, axis, centre, basis, scale)

    directions = np.array([start.axis for start in starts])
    origins = np.array([start.point for start in starts])
    return _fitted(directions, origins, len(points), linearised)


def fit_reflections(
    starts: Sequence[ReflectionSymmetry], points: Array, normals: Array
) -> list[Fit]:
    """Fit each of some planes to `points` and `normals` (n, 3) of a surface, metres, any frame.

    One whose images hardly meet the surface stays as it is.
    """
    moved, seen = points[::EVERY].copy(), Neighbours.of(points)

    def linearised(normal: Array, point: Array, basis: Array, scale: float) -> Sums:
        images = mirrored(moved, normal, point)
        met = images, *seen.nearest(images)
        return plane_sums(points, normals, EVERY, *met, normal, point, basis, scale)

    directions = np.array([start.normal for start in starts])
    origins = np.array([start.point for start in starts])
    fits = _fitted(directions, origins, len(moved), linearised, along=True)
    return [
        fit if fit.support >= MIN_OVERLAP else Fit(start.normal, start.point, fit.support)
        for fit, start in zip(fits, starts, strict=True)
    ]


def _fitted(
    directions: Array, points: Array, count: int, linearised: Linearised, *, along: bool = False
) -> list[Fit]:
    """Gauss-Newton with annealed Tukey weights from `directions` and `points`, the priors.

    Four unknowns each: two turns of the direction, then either two offsets across it (an axis) or,
    `along`, one offset along it (a plane) and one that is not used. `count` residuals each.
    """
    start = unit(directions)
    basis = basis_from_direction(start)[..., 1:].copy()
    offsets = np.stack([start, np.zeros_like(start)], -1) if along else basis
    share = EFFECTIVE_POINTS / max(count, 1) / NOISE**2
    direction, point = start, points
    total, weight = np.zeros((len(start), 4)), np.zeros(len(start))
    for scale in STEP_SCALES.tolist():
        sums = linearised(direction, point, basis, scale)
        weight, starts = sums[2], (start, points, basis)
        total, direction, point = stepped(starts, offsets, total, sums, share, PRECISION)
    support = (weight / max(count, 1)).tolist()
    return [Fit(*each) for each in zip(direction, point, support, strict=True)]


def fit_sphere(point: Array, points: Array, normals: Array) -> Fit:
    """Fit a centre, from `point` (3,), to `points` and `normals` (n, 3) of a surface, metres.

    Each normal's line passes through the centre; the support counts points at the radius, too.
    """
    share = EFFECTIVE_POINTS / max(len(points), 1) / NOISE**2
    centre, weight = fitted_sphere(points, normals, point, STEP_SCALES, share, PRIOR_OFFSET**-2.0)
    return Fit(np.full(3, np.nan), centre, weight / max(len(points), 1))
