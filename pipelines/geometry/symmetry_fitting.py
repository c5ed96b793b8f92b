"""Fits of predicted symmetries to the points of one view.

The network's prediction is rough, the measured surface exact. A rotation axis meets the normal line
of every point on its surface; a mirror image is on the surface where the surface is seen. A few
robust Gauss-Newton steps start from the prediction and keep it as a prior, which constrains the
unknowns that one view does not determine.
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
    mirror_images,
    plane_sums,
    stepped,
)
from pipelines.geometry.numerics.nearest import Neighbors
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.transforms import basis_from_direction, cross, unit

GAUSS_NEWTON_STEPS = 5  # further steps change nothing; nearest neighbours of images cost most
IMAGE_STRIDE = 4  # every fourth point is mirrored, onto all points
NOISE = 0.003  # metres, standard deviation of the residuals of a good fit
PRIOR_ANGLE = np.radians(20.0)  # standard deviation of a prediction
PRIOR_OFFSET = 0.015  # metres
PRECISION = np.array([PRIOR_ANGLE, PRIOR_ANGLE, PRIOR_OFFSET, PRIOR_OFFSET]) ** -2.0
STEP_SCALES = np.geomspace(*SCALES, GAUSS_NEWTON_STEPS)
# Errors of neighbouring points are correlated: any region weighs as much as this many points.
EFFECTIVE_POINTS = 60
MIN_OVERLAP = 0.25  # share of mirrored points on seen surface; with less, the plane is unchanged


@dataclass(frozen=True)
class SymmetryFit:
    """A fitted direction (3,) and point (3,), and their support: share of the surface explained."""

    direction: Array
    point: Array
    support: float


# Arguments: directions (k, 3), points (k, 3), bases (k, 3, 2), scale in metres.
Linearised = Callable[[Array, Array, Array, float], Sums]


def fit_rotations(
    starts: Sequence[RotationSymmetry], points: Array, normals: Array
) -> list[SymmetryFit]:
    """Fit each axis to `points` and `normals` (n, 3) of a surface, metres, any frame."""
    rows = np.concatenate([cross(points, normals), normals], axis=1)
    squares = (rows[:, :, None] * rows[:, None, :]).reshape(-1, 36)

    def linearised(axis: Array, center: Array, basis: Array, scale: float) -> Sums:
        return axis_sums(rows, squares, axis, center, basis, scale)

    directions = np.array([start.axis for start in starts])
    origins = np.array([start.point for start in starts])
    return _fitted(directions, origins, len(points), linearised)


def fit_reflections(
    starts: Sequence[ReflectionSymmetry], points: Array, normals: Array
) -> list[SymmetryFit]:
    """Fit each plane to `points` and `normals` (n, 3) of a surface, metres, any frame.

    A plane with support below `MIN_OVERLAP` is unchanged.
    """
    moved, seen = points[::IMAGE_STRIDE].copy(), Neighbors.of(points)

    def linearised(normal: Array, point: Array, basis: Array, scale: float) -> Sums:
        images = mirror_images(moved, normal, point)
        met = images, *seen.nearest(images)
        return plane_sums(points, normals, IMAGE_STRIDE, *met, normal, point, basis, scale)

    directions = np.array([start.normal for start in starts])
    origins = np.array([start.point for start in starts])
    fits = _fitted(directions, origins, len(moved), linearised, along=True)
    return [
        fit if fit.support >= MIN_OVERLAP else SymmetryFit(start.normal, start.point, fit.support)
        for fit, start in zip(fits, starts, strict=True)
    ]


def _fitted(
    directions: Array, points: Array, count: int, linearised: Linearised, *, along: bool = False
) -> list[SymmetryFit]:
    """Fit by Gauss-Newton with annealed Tukey weights from priors `directions`, `points` (k, 3).

    Each fit has `count` residuals and four unknowns: two turns of the direction, then two offsets
    across the direction (an axis) or, with `along`, one along it (a plane) and an unused one.
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
    return [SymmetryFit(*each) for each in zip(direction, point, support, strict=True)]


def fit_sphere(point: Array, points: Array, normals: Array) -> SymmetryFit:
    """Fit the centre of a sphere, from `point` (3,), to `points` and `normals` (n, 3), metres.

    The line of each normal passes through the centre; the support counts points at the radius.
    """
    share = EFFECTIVE_POINTS / max(len(points), 1) / NOISE**2
    center, weight = fitted_sphere(points, normals, point, STEP_SCALES, share, PRIOR_OFFSET**-2.0)
    return SymmetryFit(np.full(3, np.nan), center, weight / max(len(points), 1))
