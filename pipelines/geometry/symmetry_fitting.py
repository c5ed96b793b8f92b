"""Fit a predicted symmetry to the points that one view shows.

A network sees a symmetry roughly; the measured surface says it exactly. A rotation axis meets the
normal line of every point of the surface that it turns. A mirror image must lie on the surface
where that is seen. Both are fitted by a few robust Gauss-Newton steps from the prediction, which
stays as a prior: what one view cannot show must not run away.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.transforms import basis_from_direction, unit

Array = NDArray[np.float64]

STEPS = 8
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


Linearised = Callable[[Array, Array, Array], tuple[Array, Array]]


def fit_rotation(symmetry: RotationSymmetry, points: Array, normals: Array) -> Fit:
    """Fit an axis to `points` and `normals` (n, 3) of a surface, metres, any frame."""

    def linearised(axis: Array, centre: Array, basis: Array) -> tuple[Array, Array]:
        across = np.cross(normals, axis)
        length = np.maximum(np.linalg.norm(across, axis=1), MIN_SLOPE)[:, None]
        foot = points - centre
        residual = np.einsum("ij,ij->i", across, foot) / length[:, 0]
        turned = np.stack([np.cross(normals, e) for e in basis.T], 1)
        by_axis = np.einsum("nki,ni->nk", turned, foot) / length
        return residual, np.concatenate([by_axis, -(across / length) @ basis], 1)

    return _fitted(symmetry.axis, symmetry.point, linearised)


def fit_reflection(symmetry: ReflectionSymmetry, points: Array, normals: Array) -> Fit:
    """Fit a mirror plane to `points` and `normals` (n, 3) of a surface, metres, any frame."""
    tree = KDTree(points)

    def linearised(normal: Array, point: Array, basis: Array) -> tuple[Array, Array]:
        plane = ReflectionSymmetry(normal, point)
        image = plane.counterpart(points)
        _, nearest = tree.query(image)
        target = normals[nearest]
        alike = np.einsum("ij,ij->i", plane.mirror_vectors(normals), target) > MATCH_NORMAL
        residual = np.einsum("ij,ij->i", target, image - points[nearest])
        height = (points - point) @ normal
        moves = [
            -2.0 * (((points - point) @ e)[:, None] * normal + height[:, None] * e) for e in basis.T
        ]
        by_normal = np.stack([np.einsum("ij,ij->i", target, move) for move in moves], 1)
        by_offset = 2.0 * (target @ normal)[:, None]
        # An image beside the seen surface meets its border: that says nothing of the plane.
        beside = np.linalg.norm(image - points[nearest], axis=1) - np.abs(residual) > SCALES[0] / 2
        return (
            np.where(alike & ~beside, residual, np.inf),
            np.concatenate([by_normal, by_offset, np.zeros_like(by_offset)], 1),
        )

    fit = _fitted(symmetry.normal, symmetry.point, linearised, along=True)
    if fit.support < MIN_OVERLAP:
        return Fit(symmetry.normal, symmetry.point, fit.support)
    return fit


def _fitted(direction: Array, point: Array, linearised: Linearised, *, along: bool = False) -> Fit:
    """Gauss-Newton with annealed Tukey weights from `direction` and `point`, the prior.

    Four unknowns: two turns of the direction, then either two offsets across it (an axis) or,
    `along`, one offset along it (a plane) and one that is not used.
    """
    start_direction, start_point = unit(direction), np.asarray(point, np.float64)
    basis = basis_from_direction(start_direction)[:, 1:]
    offsets = np.stack([start_direction, np.zeros(3)], 1) if along else basis
    sigma = np.array([PRIOR_ANGLE, PRIOR_ANGLE, PRIOR_OFFSET, PRIOR_OFFSET])
    total, support = np.zeros(4), 0.0
    for scale in np.geomspace(*SCALES, STEPS):
        axis = unit(start_direction + basis @ total[:2])
        residual, jacobian = linearised(axis, start_point + offsets @ total[2:], basis)
        near = np.abs(residual) < scale
        weight = np.where(near, (1.0 - np.where(near, residual / scale, 0.0) ** 2) ** 2, 0.0)
        support = float(weight.mean())
        share = EFFECTIVE_POINTS / max(len(residual), 1) / NOISE**2
        finite = np.where(near, residual, 0.0)
        normal_matrix = share * (jacobian * weight[:, None]).T @ jacobian + np.diag(sigma**-2.0)
        gradient = share * jacobian.T @ (weight * finite) + total / sigma**2
        total = total - np.linalg.solve(normal_matrix, gradient)
    axis = unit(start_direction + basis @ total[:2])
    return Fit(axis, start_point + offsets @ total[2:], support)


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
