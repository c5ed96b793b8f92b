"""Fit a predicted symmetry to the points that one view shows.

A network sees a symmetry roughly; the measured surface says it exactly. A rotation axis meets the
normal line of every point of the surface that it turns. A mirror image must lie on the surface
where that is seen. Both are fitted by a few robust Gauss-Newton steps from the prediction, which
stays as a prior: what one view cannot show must not run away.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.nearest import nearest_of
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.transforms import basis_from_direction, cross, unit

Array = NDArray[np.float64]

STEPS = 5  # more lead nowhere better; a plane's cost most, its images look for their neighbours
EVERY = 4  # so many-th point is mirrored, onto all
SCALES = (0.020, 0.004)  # metres, Tukey's biweight at the first and at the last step
NOISE = 0.003  # metres, standard deviation of a residual that fits
PRIOR_ANGLE = np.radians(20.0)  # standard deviation of a prediction
PRIOR_OFFSET = 0.015  # metres
# Neighbouring points err together: a region of any size says as much as this many points.
EFFECTIVE_POINTS = 60
MIN_SLOPE = 0.2  # sine between normal and axis; flatter ends say little about the axis
MATCH_NORMAL = np.cos(np.radians(40.0))
MIN_OVERLAP = 0.25  # share of mirrored points that must meet seen surface, else nothing is known


@dataclass(frozen=True)
class Fit:
    """A fitted direction and point, and how well they explain the surface: 0 not, 1 all of it."""

    direction: Array
    point: Array
    support: float


# From k directions, k points and k bases: residuals (k, n) and their derivatives (k, n, 4).
Linearised = Callable[[Array, Array, Array], tuple[Array, Array]]


def fit_rotations(starts: Sequence[RotationSymmetry], points: Array, normals: Array) -> list[Fit]:
    """Fit each of some axes to `points` and `normals` (n, 3) of a surface, metres, any frame."""
    moments = np.cross(points, normals)

    def linearised(axis: Array, centre: Array, basis: Array) -> tuple[Array, Array]:
        # (n x v) . (p - c) = v . (p x n) - n . (v x c): two products of matrices for all points.
        turned = np.concatenate([axis[:, None], basis.transpose(0, 2, 1)], 1)
        arms = turned @ moments.T - cross(turned, centre[:, None]) @ normals.T
        across = cross(axis[:, None], basis.transpose(0, 2, 1)) @ normals.T
        length = np.sqrt(np.maximum(1.0 - (axis @ normals.T) ** 2, MIN_SLOPE**2))
        rows = np.concatenate([arms, -across], 1) / length[:, None]
        return rows[:, 0], rows[:, 1:].transpose(0, 2, 1)

    directions = np.array([start.axis for start in starts])
    origins = np.array([start.point for start in starts])
    return _fitted(directions, origins, linearised)


def fit_reflections(
    starts: Sequence[ReflectionSymmetry], points: Array, normals: Array
) -> list[Fit]:
    """Fit each of some planes to `points` and `normals` (n, 3) of a surface, metres, any frame.

    One whose images hardly meet the surface stays as it is.
    """
    # An image farther off than this is beside the seen surface, or misses it by more than a scale.
    reach = SCALES[0] / 2 + SCALES[0]
    moved, facing = points[::EVERY], normals[::EVERY]

    def linearised(normal: Array, point: Array, basis: Array) -> tuple[Array, Array]:
        foot = moved - point[:, None]
        height = np.einsum("kni,ki->kn", foot, normal)
        image = moved - 2.0 * height[..., None] * normal[:, None]
        distance, nearest = nearest_of(points, image)
        target = normals[nearest]
        alike = face_alike(facing, target, normal)
        residual = np.einsum("kni,kni->kn", target, image - points[nearest])
        along_normal = np.einsum("kni,ki->kn", target, normal)
        by_normal = -2.0 * (
            (foot @ basis) * along_normal[..., None] + height[..., None] * (target @ basis)
        )
        by_offset = 2.0 * along_normal[..., None]
        # An image beside the seen surface meets its border: that says nothing of the plane.
        beside = (distance > reach) | (distance - np.abs(residual) > SCALES[0] / 2)
        jacobian = np.concatenate([by_normal, by_offset, np.zeros_like(by_offset)], -1)
        return np.where(alike & ~beside, residual, np.inf), jacobian

    directions = np.array([start.normal for start in starts])
    origins = np.array([start.point for start in starts])
    fits = _fitted(directions, origins, linearised, along=True)
    return [
        fit if fit.support >= MIN_OVERLAP else Fit(start.normal, start.point, fit.support)
        for fit, start in zip(fits, starts, strict=True)
    ]


def face_alike(normals: Array, met: Array, planes: Array) -> NDArray[np.bool_]:
    """Return (k, n) where `normals` (n, 3), mirrored in planes of normals (k, 3), face as `met`.

    `met`: (k, n, 3) the normals of the surface where each image lies.
    """
    across = (planes @ normals.T) * np.einsum("kni,ki->kn", met, planes)
    cosine = np.einsum("ni,kni->kn", normals, met) - 2.0 * across
    return np.asarray(cosine > MATCH_NORMAL)


def _fitted(
    directions: Array, points: Array, linearised: Linearised, *, along: bool = False
) -> list[Fit]:
    """Gauss-Newton with annealed Tukey weights from `directions` and `points`, the priors.

    Four unknowns each: two turns of the direction, then either two offsets across it (an axis) or,
    `along`, one offset along it (a plane) and one that is not used.
    """
    start = unit(directions)
    basis = basis_from_direction(start)[..., 1:]
    offsets = np.stack([start, np.zeros_like(start)], -1) if along else basis
    sigma = np.array([PRIOR_ANGLE, PRIOR_ANGLE, PRIOR_OFFSET, PRIOR_OFFSET])
    total, support = np.zeros((len(start), 4)), np.zeros(len(start))

    def moved() -> tuple[Array, Array]:
        turned = np.einsum("kij,kj->ki", basis, total[:, :2])
        return unit(start + turned), points + np.einsum("kij,kj->ki", offsets, total[:, 2:])

    for scale in np.geomspace(*SCALES, STEPS):
        residual, jacobian = linearised(*moved(), basis)
        near = np.abs(residual) < scale
        finite = np.where(near, residual, 0.0)
        weight = np.where(near, (1.0 - (finite / scale) ** 2) ** 2, 0.0)
        support = weight.mean(axis=1)
        share = EFFECTIVE_POINTS / max(residual.shape[1], 1) / NOISE**2
        weighted = (jacobian * weight[..., None]).transpose(0, 2, 1)
        normal_matrix = share * weighted @ jacobian + np.diag(sigma**-2.0)
        gradient = share * np.einsum("kin,kn->ki", weighted, finite) + total / sigma**2
        total = total - np.linalg.solve(normal_matrix, gradient[..., None])[..., 0]
    return [Fit(*each) for each in zip(*moved(), support.tolist(), strict=True)]


def fit_sphere(point: Array, points: Array, normals: Array) -> Fit:
    """Fit a centre, from `point` (3,), to `points` and `normals` (n, 3) of a surface, metres.

    Each normal's line passes through the centre; the support counts points at the radius, too.
    """
    centre = np.asarray(point, np.float64)
    support = 0.0
    for scale in np.geomspace(*SCALES, STEPS):
        foot = points - centre
        across = foot - np.einsum("ij,ij->i", foot, normals)[:, None] * normals
        distance = np.linalg.norm(across, axis=1)
        radius = np.median(np.linalg.norm(foot, axis=1))
        uneven = np.abs(np.linalg.norm(foot, axis=1) - radius)
        near = np.maximum(distance, uneven) < scale
        weight = np.where(near, (1.0 - np.where(near, distance / scale, 0.0) ** 2) ** 2, 0.0)
        support = float(weight.mean())
        share = EFFECTIVE_POINTS / max(len(points), 1) / NOISE**2
        spread = np.eye(3) * weight.sum() - np.einsum("n,ni,nj->ij", weight, normals, normals)
        pull = np.einsum("n,ni->i", weight, across)
        prior = np.eye(3) / PRIOR_OFFSET**2
        step = share * pull + (point - centre) / PRIOR_OFFSET**2
        centre = centre + np.linalg.solve(share * spread + prior, step)
    return Fit(np.full(3, np.nan), centre, support)
