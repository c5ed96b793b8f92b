"""Search for the candidate planes and axes of a mesh, refined and measured.

Normalised coordinates: origin at the surface's centroid, unit diameter. Planes are rows
(nx, ny, nz, d) of n.x = d, axes rows (ux, uy, uz, px, py, pz), best first.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.mesh_symmetry.detection.revolution_candidates import revolution_candidates
from pipelines.mesh_symmetry.detection.symmetry_candidates import (
    DistanceGrid,
    distinct_candidates,
    plane_candidates,
    principal_axis_rows,
)
from pipelines.mesh_symmetry.detection.symmetry_refinement import refine_axes, refine_planes
from pipelines.mesh_symmetry.detection.symmetry_verification import (
    VERIFICATION_ANGLES,
    Samples,
    SurfaceFit,
    mirror_samples,
)
from pipelines.mesh_symmetry.detection.unit_surface import (
    UnitSurface,
    continuous_fit,
    fit_of_plane,
    fit_of_turn,
    staged_fit,
)

COARSE_SCALES = (0.05, 0.04, 0.03, 0.025)  # Tukey scales, shares of the diameter
FINE_SCALES = (0.03, 0.02, 0.015, 0.012, 0.012)
FINAL_SCALES = (0.012, 0.01, 0.01)
REFINEMENT_ANGLES = VERIFICATION_ANGLES[1::2]
COARSE_SAMPLES, FINE_SAMPLES, FINAL_SAMPLES = 200, 600, 2000
KEPT_PLANES = 14  # the most distinct planes after a refinement
MISS_CAP = 0.05  # of the diameter; cap of misses
MAX_MISS = 0.5 * MISS_CAP  # a plane that fits less than half of a surface is dropped
MORE_ROUNDS = 3  # of refinement, for an axis that still moves
# Radians, and of the diameter: a step of an axis that no longer moves.
AT_REST_ANGLE, AT_REST_OFFSET = float(np.radians(0.1)), 0.001
LEAST_ANGLE = float(np.radians(3.0))  # between distinct planes
LEAST_OFFSET = 0.015  # of the diameter, between distinct planes


def search_planes(
    shape: UnitSurface, grid: DistanceGrid, config: AnnotateSymmetryConfig
) -> tuple[Array, list[SurfaceFit]]:
    """Return distinct refined planes (c, 4) and their fits."""
    normals, offsets = plane_candidates(grid, shape.points(COARSE_SAMPLES), config)
    planes = np.column_stack([normals, offsets])
    planes = _distinct_planes(shape, refined_planes(shape, planes, COARSE_SCALES, COARSE_SAMPLES))
    planes = _distinct_planes(shape, refined_planes(shape, planes, FINE_SCALES, FINE_SAMPLES))
    fits = [staged_fit(shape, config, partial(fit_of_plane, shape, plane)) for plane in planes]
    good = [index for index, fit in enumerate(fits) if fit.holds(config)]
    if good:
        planes[good] = refined_planes(shape, planes[good], FINAL_SCALES, FINAL_SAMPLES)
    order = np.argsort([fit.loss for fit in fits], kind="stable")
    return planes[order], [fits[index] for index in order]


def refined_planes(shape: UnitSurface, planes: Array, scales: Sequence[float], count: int) -> Array:
    """Return `planes` (c, 4) after one Gauss-Newton step for each scale, on `count` samples."""
    points = shape.points(count)
    normals, offsets = refine_planes(shape.surface, points, planes[:, :3], planes[:, 3], scales)
    return np.column_stack([normals, offsets])


def search_axes(
    shape: UnitSurface, config: AnnotateSymmetryConfig
) -> tuple[Array, list[tuple[SurfaceFit, bool]]]:
    """Return distinct axes (c, 6), and the (worst fit, is continuous) of each.

    The start of a refinement and the principal axes remain candidates: on thin or rough surfaces, a
    refinement may diverge.
    """
    starts = revolution_candidates(
        shape.samples.points,
        shape.samples.normals,
        config.axis_candidates,
        np.radians(config.axis_separation_deg),
    )
    axes = settled_axes(shape, starts, config)
    fits = [continuous_fit(shape, axis, config) for axis in axes]
    if not any(continuous for _, continuous in fits):
        principal = np.column_stack([principal_axis_rows(shape.samples.points), np.zeros((3, 3))])
        others = np.concatenate([starts, principal])
        axes = np.concatenate([axes, others])
        fits += [continuous_fit(shape, axis, config) for axis in others]
    order = np.argsort([fit.loss for fit, _ in fits], kind="stable")
    return axes[order], [fits[index] for index in order]


def refined_axes(
    shape: UnitSurface, axes: Array, angles: Sequence[float], scales: Sequence[float], count: int
) -> Array:
    """Return `axes` (c, 6) after one Gauss-Newton step for each scale; `angles` in radians."""
    points = shape.points(count)
    parts = refine_axes(shape.surface, points, axes[:, :3], axes[:, 3:], angles, scales)
    return np.column_stack(parts)


def settled_axes(shape: UnitSurface, axes: Array, config: AnnotateSymmetryConfig) -> Array:
    """Return the `axes` (c, 6) that are not hopeless, refined until they no longer move.

    Grooves, dents and holes slow a refinement down: each round halves the remaining error.
    """
    settled = refined_axes(shape, axes, REFINEMENT_ANGLES, FINE_SCALES, FINE_SAMPLES)
    going = np.arange(len(settled))
    for _ in range(MORE_ROUNDS):
        fits = [fit_of_turn(shape, axis, np.pi, shape.few) for axis in settled[going]]
        going = going[[not fit.is_hopeless(config) for fit in fits]]
        if not len(going):
            break
        before = settled[going]
        after = refined_axes(shape, before, REFINEMENT_ANGLES, FINE_SCALES, FINE_SAMPLES)
        settled[going] = after
        along = np.abs(np.einsum("ci,ci->c", before[:, :3], after[:, :3]))
        arm = after[:, 3:] - before[:, 3:]
        arm = arm - np.einsum("ci,ci->c", arm, after[:, :3])[:, None] * after[:, :3]
        rests = (along > np.cos(AT_REST_ANGLE)) & (np.linalg.norm(arm, axis=1) < AT_REST_OFFSET)
        going = going[~rests]
    return settled


def _distinct_planes(shape: UnitSurface, planes: Array) -> Array:
    before = Samples(shape.points(COARSE_SAMPLES), shape.samples.normals[:COARSE_SAMPLES])
    images = [mirror_samples(before, plane[:3], float(plane[3])).points for plane in planes]
    distance = shape.surface.within(np.stack(images), MISS_CAP)[0]
    misses = np.minimum(distance, MISS_CAP).mean(axis=-1)
    order = np.argsort(misses, kind="stable")
    ranked = planes[order[: max(1, int(np.sum(misses < MAX_MISS)))]]
    return ranked[
        distinct_candidates(
            ranked[:, :3], ranked[:, 3], KEPT_PLANES, min_angle=LEAST_ANGLE, min_offset=LEAST_OFFSET
        )
    ]
