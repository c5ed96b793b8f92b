"""Search for the candidate planes and axes of a mesh, refined and measured.

Normalised coordinates: origin at the surface's centroid, unit diameter. Planes are rows
(nx, ny, nz, d) of n.x = d, axes rows (ux, uy, uz, px, py, pz), best first.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.errors import ValueRangeError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.mesh_symmetry.detection.nearly_round import (
    bend_of,
    bent_fits,
    is_nearly_round,
    leans_in_pattern,
)
from pipelines.mesh_symmetry.detection.surface import Surface, diameter
from pipelines.mesh_symmetry.detection.symmetry_candidates import (
    DistanceGrid,
    distinct_candidates,
    plane_candidates,
    principal_axis_rows,
)
from pipelines.mesh_symmetry.detection.symmetry_refinement import refine_axes, refine_planes
from pipelines.mesh_symmetry.detection.symmetry_revolution import revolution_candidates
from pipelines.mesh_symmetry.symmetry_verification import (
    VERIFICATION_ANGLES,
    Samples,
    SurfaceFit,
    are_round,
    fit_of,
    mirror_samples,
    normals_agree,
    turn_samples,
)

COARSE_SCALES = (0.05, 0.04, 0.03, 0.025)  # Tukey scales, shares of the diameter
FINE_SCALES = (0.03, 0.02, 0.015, 0.012, 0.012)
FINAL_SCALES = (0.012, 0.01, 0.01)
REFINEMENT_ANGLES = VERIFICATION_ANGLES[1::2]
COARSE_SAMPLES, FINE_SAMPLES, FINAL_SAMPLES = 200, 600, 2000
FEW_SAMPLES = 400
KEPT_PLANES = 14
FLAT_SHEET = 0.01  # of the diameter; largest thickness of a sheet with open rims
THIN_PLATE = 0.04  # of the diameter; largest thickness of a plate whose walls get more samples
WALL_SHARE = 0.3  # of the samples of a thin plate, on its walls
WALL_COSINE = 0.5  # largest cosine between the normal of a wall and the thin axis
WALL_REACH = 0.05  # of the diameter, the error of candidates; nearer samples represent the rim
MIN_AREA = 1e-9  # of the squared diameter; a mesh of less area is points or a line
MISS_CAP = 0.05  # of the diameter; cap of misses
MAX_MISS = 0.5 * MISS_CAP
MORE_ROUNDS = 3  # of refinement, for an axis that still moves
AT_REST_ANGLE, AT_REST_OFFSET = float(np.radians(0.1)), 0.001
SAME_ANGLE, SAME_OFFSET = float(np.radians(3.0)), 0.015  # radians, share of the diameter


@dataclass(frozen=True)
class UnitSurface:
    """A mesh's surface in normalised coordinates, x = (x_mesh - center) / size, with samples."""

    center: Array  # (3,) metres, mesh frame
    size: float  # metres
    surface: Surface
    samples: Samples
    few: Samples  # the first of the samples, to reject hopeless candidates

    @classmethod
    def from_mesh(
        cls, mesh: Mesh, config: AnnotateSymmetryConfig, rng: np.random.Generator
    ) -> "UnitSurface":
        """Sample `mesh` and bring it to its centroid and unit diameter.

        Raises:
            ValueRangeError: the triangles have no area.
        """
        size = diameter(mesh.vertices[np.unique(mesh.faces)])
        if not mesh.area > MIN_AREA * size**2:
            raise ValueRangeError("area of the mesh", mesh.area, "positive: a surface")
        raw = Surface.from_mesh(mesh, config.num_samples, rng)
        has_rim = bool(len(raw.rim.points))
        thickness = _thickness(raw) / size
        if thickness < THIN_PLATE and not has_rim:
            # A separate generator, so that samples of other parts do not depend on this call.
            own = rng.spawn(1)[0]
            raw = Surface.from_mesh(mesh, config.num_samples, own, _wall_density(mesh, raw))
        center = raw.points.mean(axis=0)
        surface = raw.normalised(center, size)
        is_sheet = has_rim and thickness < FLAT_SHEET
        if is_sheet:  # only the rim determines its position in its plane
            surface = surface.with_walls(WALL_REACH)
        verified = min(config.num_verification_samples, len(raw.points))
        draw = rng.choice(len(raw.points), verified, replace=False)
        # A card turned in its plane moves beyond its rim, which distinguishes cards from discs. A
        # sheet is complete at its rim; the surface of any other object may continue there unseen.
        make = Samples.with_links if len(surface.rim.points) and not is_sheet else Samples
        samples, few = (
            make(surface.points[some], surface.normals[some]) for some in (draw, draw[:FEW_SAMPLES])
        )
        return cls(center, size, surface, samples, few)

    def points(self, count: int) -> Array:
        """Return the points (count, 3) of the first `count` samples."""
        return self.samples.points[:count]

    def to_mesh(self, point: Array) -> Array:
        """Return `point` (3,) in the mesh frame, metres."""
        return self.center + self.size * point


def _thickness(surface: Surface) -> float:
    """Return the extent of `surface` across its best plane, without outliers."""
    height = surface.points @ principal_axis_rows(surface.points)[-1]
    return float(np.ptp(np.percentile(height, [1.0, 99.0])))


def _wall_density(mesh: Mesh, surface: Surface) -> Array:
    """Return the density (f,) of samples that puts `WALL_SHARE` of them on the walls of a plate.

    Only its walls determine the position of a plate in its plane, and they are 1 % of its area.
    """
    thin = principal_axis_rows(surface.points)[-1]
    is_wall = np.abs(mesh.face_normals @ thin) < WALL_COSINE
    share = float(mesh.face_areas[is_wall].sum() / mesh.area)
    factor = WALL_SHARE / (1.0 - WALL_SHARE) * (1.0 - share) / share if share > 0.0 else 1.0
    return np.where(is_wall, max(factor, 1.0), 1.0)


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


def staged_fit(
    shape: UnitSurface, config: AnnotateSymmetryConfig, measure: Callable[[Samples], SurfaceFit]
) -> SurfaceFit:
    """Return the fit of `measure` on all samples, or on few samples if the fit is hopeless."""
    fit = measure(shape.few)
    return fit if fit.is_hopeless(config) else measure(shape.samples)


def fit_of_plane(shape: UnitSurface, plane: Array, samples: Samples) -> SurfaceFit:
    """Measure the plane (4,) on `samples` of the shape."""
    return fit_of(shape.surface, samples, mirror_samples(samples, plane[:3], float(plane[3])))


def fit_of_turn(shape: UnitSurface, axis: Array, angle: float, samples: Samples) -> SurfaceFit:
    """Measure a turn by `angle` radians about the axis (6,) on `samples` of the shape."""
    image = turn_samples(samples, axis[:3], axis[3:], angle)
    return fit_of(shape.surface, samples, image, angle)


def continuous_fit(
    shape: UnitSurface, axis: Array, config: AnnotateSymmetryConfig
) -> tuple[SurfaceFit, bool]:
    """Return the worst fit of the axis (6,) over generic angles, and whether it is continuous.

    Stops at the first angle at which the symmetry does not hold.
    """
    surface, samples = shape.surface, shape.samples
    fits: list[SurfaceFit] = []
    for angle in VERIFICATION_ANGLES:
        fits.append(staged_fit(shape, config, partial(fit_of_turn, shape, axis, angle)))
        if not fits[-1].may_turn(config):
            return fits[-1], False
    worst = max(fits, key=attrgetter("miss"))
    if not normals_agree(fits, config) or leans_in_pattern(samples, axis, surface.noise):
        return worst, False
    if not all(fit.is_small_beside_width(config) for fit in fits):
        fits = bent_fits(surface, samples, axis, bend_of(surface, samples, axis))
        if not all(fit.is_small_beside_width(config) for fit in fits):
            return worst, False
    is_round = worst.ovalness <= 1.0 and are_round(fits)
    return worst, is_round or is_nearly_round(surface, samples, axis)


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
    # A plane that fits less than half of the surface is no plane of a region either.
    ranked = planes[order[: max(1, int(np.sum(misses < MAX_MISS)))]]
    return ranked[
        distinct_candidates(
            ranked[:, :3], ranked[:, 3], KEPT_PLANES, min_angle=SAME_ANGLE, min_offset=SAME_OFFSET
        )
    ]
