"""Symmetries of spheres: a ball by its radius, a hollow ball by its axes.

The two skins of a hollow ball have no common radius; but an object that is symmetric about two
continuous axes is symmetric about every axis through their intersection.
"""

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.symmetry import SphereSymmetry
from pipelines.geometry.transforms import unit
from pipelines.mesh_symmetry.detection.symmetry_refinement import robust_sphere
from pipelines.mesh_symmetry.detection.symmetry_verification import SUPPORT_COSINE, Samples
from pipelines.mesh_symmetry.detection.unit_surface import UnitSurface, continuous_fit

MAX_MEAN, MAX_P95 = 0.01, 0.025  # of the diameter, between samples and a ball
MAX_OFFCENTER, MIN_SPREAD = 0.2, 0.2  # exclude caps


def sphere_of(shape: UnitSurface, config: AnnotateSymmetryConfig) -> SphereSymmetry | None:
    """Return the symmetry of `shape` if it is a sphere, mesh frame, metres."""
    return _ball(shape) or _hollow_ball(shape, config)


def _ball(shape: UnitSurface) -> SphereSymmetry | None:
    points = shape.samples.points
    center, radius = robust_sphere(points)
    gap = np.abs(np.linalg.norm(points - center, axis=1) - radius)
    near = gap.mean() <= MAX_MEAN and np.percentile(gap, 95.0) <= MAX_P95
    if not (near and _surrounds(points, center)):
        return None
    return SphereSymmetry(shape.to_mesh(center), float(gap.mean() / (2.0 * radius)))


def _hollow_ball(shape: UnitSurface, config: AnnotateSymmetryConfig) -> SphereSymmetry | None:
    center = _common_point(shape.samples)
    if not _looks_radial(shape, center, config):
        return None
    fits = []
    for direction in np.eye(3):
        fit, continuous = continuous_fit(shape, np.concatenate([direction, center]), config)
        if not continuous:
            return None
        fits.append(fit)
    return SphereSymmetry(shape.to_mesh(center), max(fit.error for fit in fits))


def _common_point(samples: Samples) -> Array:
    """Return the point (3,) nearest to the lines of the normals."""
    across = np.eye(3) - samples.normals[:, :, None] * samples.normals[:, None, :]
    system = across.sum(axis=0) + 1e-9 * len(across) * np.eye(3)
    right = np.einsum("nij,nj->i", across, samples.points)
    return np.asarray(np.linalg.solve(system, right))


def _looks_radial(shape: UnitSurface, center: Array, config: AnnotateSymmetryConfig) -> bool:
    """Return whether `shape` surrounds `center` (3,) and its normals point away from or to it."""
    samples = shape.samples
    radial = np.einsum("nd,nd->n", samples.normals, unit(samples.points - center))
    share = float(np.mean(np.abs(radial) > SUPPORT_COSINE))
    enough = config.min_agreement * shape.surface.agreement
    return share >= enough and _surrounds(samples.points, center)


def _surrounds(points: Array, center: Array) -> bool:
    """Return whether `points` (n, 3) lie on all sides of `center` (3,)."""
    arm = points - center
    directions = arm / np.maximum(np.linalg.norm(arm, axis=1), 1e-9)[:, None]
    spread = np.linalg.eigvalsh(directions.T @ directions / len(points))
    offcenter = np.linalg.norm(directions.mean(axis=0))
    return bool(offcenter <= MAX_OFFCENTER and spread[0] >= MIN_SPREAD)
