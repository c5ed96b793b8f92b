"""Rotation axes and sphere centres fitted to the points of one view. Camera frame, metres.

An axis meets the normal line of every point on its surface; all normal lines of a sphere meet at
its centre. The published method has no spheres.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.directions import sphere_directions
from pipelines.geometry.symmetry import RotationSymmetry, SphereSymmetry
from pipelines.geometry.symmetry_icp.surface import (
    OCCLUSION_POWER,
    FreeSpace,
    SeenSurface,
    largest_gaps,
    ramp,
)
from pipelines.geometry.transforms import basis_from_direction, unit

THINNING = 0.005  # metres
MIN_SURFACE = 20  # points inside the rim below which the rim is used too
MAX_ERROR = np.pi / 4  # radians, largest error of a point in the fit
FULL_FIT, FULL_MISS = 10.0, 60.0  # degrees, limits of the score's ramp over a point's error
TURNS = 2 * np.pi * np.arange(1, 12) / 12  # radians, by which points are turned about an axis
# Limits of accepted fits, shares 0 to 1.
MAX_MEAN_ERROR, MAX_OCCLUSION, MAX_PERPENDICULARITY = 0.02, 0.012, 0.6
MIN_COVERAGE, MIN_SPHERE_COVERAGE = 0.3, 0.1
DIRECTIONS = 200  # over the sphere; a point covers all directions within the next angle
COVER_COSINE = np.cos(np.radians(10.0))
MAX_EVALUATIONS = 60  # of the errors, by the least-squares solver
SPHERE_AXES = 3  # random axes that a sphere's points are turned about


@dataclass(frozen=True)
class BodyFit:
    """An axis or a sphere and its scores, shares 0 to 1.

    Attributes:
        symmetry: the axis or the sphere.
        error: mean error of normals that do not meet the axis or centre; 0 for none.
        occlusion: degree to which turned points are in free space; 0 for none.
        coverage: share of the turn, or of the solid angle, that the points cover.
        is_accepted: whether the fit passes the thresholds.
    """

    symmetry: RotationSymmetry | SphereSymmetry
    error: float
    occlusion: float
    coverage: float
    is_accepted: bool

    @property
    def confidence(self) -> float:
        """Order for average precision; the published method only filters."""
        return (1.0 - self.error) * (1.0 - self.occlusion) ** OCCLUSION_POWER * self.coverage


def smooth_part(surface: SeenSurface) -> SeenSurface:
    """Return the points of `surface` that axes and spheres are fitted to."""
    thin = surface.thinned(THINNING)
    inner = thin.without_rim()
    return inner if len(inner) >= MIN_SURFACE else thin


def axis_fit(surface: SeenSurface, space: FreeSpace) -> BodyFit:
    """Return the best axis of `surface`, one of `smooth_part`.

    The accepted axis of least occlusion; if none is accepted, the most confident axis.
    """
    points = surface.points
    mean = points.mean(axis=0)
    axes = np.linalg.svd(points - mean, full_matrices=False)[2]
    fits = [_scored_axis(_refined_axis(surface, axis, mean), surface, space) for axis in axes]
    accepted = [fit for fit in fits if fit.is_accepted]
    if accepted:
        return min(accepted, key=lambda fit: (fit.occlusion, -fit.confidence))
    return max(fits, key=lambda fit: fit.confidence)


def _refined_axis(surface: SeenSurface, axis: Array, mean: Array) -> RotationSymmetry:
    """Return the axis that normal lines miss least, from `axis` (3,) through `mean` (3,)."""
    basis = basis_from_direction(axis)[:, 1:]

    def moved(step: Array) -> tuple[Array, Array]:
        return unit(axis + basis @ step[:2]), mean + basis @ step[2:]

    def errors(step: Array) -> Array:
        return np.minimum(_axis_errors(surface, *moved(step)), MAX_ERROR)

    return RotationSymmetry(*moved(_least(errors, 4)))


def _axis_errors(surface: SeenSurface, axis: Array, foot: Array) -> Array:
    """Return the angles (n,) in radians between normals and the planes through the axis."""
    tangents = unit(np.cross(surface.points - foot, axis))
    sine = np.abs(np.einsum("ni,ni->n", surface.normals, tangents))
    return np.asarray(np.arcsin(np.clip(sine, 0.0, 1.0)))


def _least(errors: Callable[[Array], Array], unknowns: int) -> Array:
    """Return the step (unknowns,) with the least squared `errors`."""
    from scipy.optimize import least_squares  # noqa: PLC0415 - slow to import, one method needs it

    start = np.zeros(unknowns)
    found = least_squares(errors, start, x_scale="jac", max_nfev=MAX_EVALUATIONS)
    return np.asarray(found.x)


def _scored_axis(axis: RotationSymmetry, surface: SeenSurface, space: FreeSpace) -> BodyFit:
    points, normals = surface.points, surface.normals
    error = _mean_error(_axis_errors(surface, axis.axis, axis.point))
    occlusion = float(space.occupancy_error(axis.turn(points, TURNS)).max(axis=0).mean())
    basis = basis_from_direction(axis.axis)[:, 1:]
    flat = (points - axis.point) @ basis
    coverage = 1.0 - float(largest_gaps(np.arctan2(flat[:, 1], flat[:, 0]))) / (2 * np.pi)
    angle = np.arccos(np.clip(np.abs(normals @ axis.axis), 0.0, 1.0))
    perpendicularity = float(np.mean(1.0 - angle / (np.pi / 2)))
    accepted = error < MAX_MEAN_ERROR and occlusion < MAX_OCCLUSION and coverage > MIN_COVERAGE
    accepted &= perpendicularity < MAX_PERPENDICULARITY
    return BodyFit(axis, error, occlusion, coverage, accepted)


def sphere_fit(surface: SeenSurface, space: FreeSpace) -> BodyFit:
    """Return the sphere of `surface`, one of `smooth_part`."""
    points, normals = surface.points, surface.normals
    across = np.eye(3) - normals[:, :, None] * normals[:, None]
    meeting = np.linalg.pinv(across.sum(axis=0)) @ np.einsum("nij,nj->i", across, points)
    step = _least(lambda s: np.minimum(_sphere_errors(surface, meeting + s), MAX_ERROR), 3)
    center = meeting + step
    error = _mean_error(_sphere_errors(surface, center))
    axes = unit(np.random.default_rng(0).normal(size=(SPHERE_AXES, 3)))
    turned = [RotationSymmetry(axis, center).turn(points, TURNS) for axis in axes]
    occlusion = float(space.occupancy_error(np.concatenate(turned)).max(axis=0).mean())
    covered = sphere_directions(DIRECTIONS) @ unit(points - center).T > COVER_COSINE
    coverage = float(covered.any(axis=1).mean())
    accepted = error < MAX_MEAN_ERROR and occlusion < MAX_OCCLUSION
    accepted &= coverage > MIN_SPHERE_COVERAGE
    return BodyFit(SphereSymmetry(center), error, occlusion, coverage, accepted)


def _sphere_errors(surface: SeenSurface, center: Array) -> Array:
    """Return the angles (n,) in radians between normals and directions away from `center`."""
    cosine = np.einsum("ni,ni->n", surface.normals, unit(surface.points - center))
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _mean_error(errors: Array) -> float:
    """Return the mean error, 0 to 1, of the angles `errors` (n,), radians."""
    return float(ramp(np.degrees(errors), FULL_FIT, FULL_MISS).mean())
