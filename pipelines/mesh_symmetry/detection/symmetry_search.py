"""From a mesh to its best candidate planes and axes, refined and measured.

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
from pipelines.mesh_symmetry.detection.surface import Surface, diameter
from pipelines.mesh_symmetry.detection.symmetry_candidates import (
    DistanceGrid,
    distinct,
    plane_candidates,
    principal_axes,
)
from pipelines.mesh_symmetry.detection.symmetry_refinement import refine_axes, refine_planes
from pipelines.mesh_symmetry.detection.symmetry_revolution import revolution_candidates
from pipelines.mesh_symmetry.symmetry_verification import (
    VERIFICATION_ANGLES,
    Fit,
    Samples,
    are_round,
    fit_of,
    mirrored,
    turned,
)

COARSE_SCALES = (0.05, 0.04, 0.03, 0.025)  # Tukey scales, shares of the diameter
FINE_SCALES = (0.03, 0.02, 0.015, 0.012, 0.012)
FINAL_SCALES = (0.012, 0.01, 0.01)
REFINEMENT_ANGLES = VERIFICATION_ANGLES[1::2]
COARSE_SAMPLES, FINE_SAMPLES, FINAL_SAMPLES = 200, 600, 2000
FEW_SAMPLES = 400
KEPT_PLANES = 14
FLAT_SHEET = 0.01  # of the diameter; a surface with open rims that is no thicker
WALL_REACH = 0.05  # of the diameter, as candidates err by; nearer samples stand for a sheet's rim
MIN_AREA = 1e-9  # of the squared diameter; a mesh of less is points or a line
MISS_CAP = 0.05  # of the diameter; a larger miss is no worse
MAX_MISS = 0.5 * MISS_CAP
SAME_ANGLE, SAME_OFFSET = float(np.radians(3.0)), 0.015


@dataclass(frozen=True)
class Shape:
    """A mesh's surface in normalised coordinates, `x = (x_mesh - center) / size`, with samples."""

    center: Array  # (3,) metres, mesh frame
    size: float  # metres
    surface: Surface
    samples: Samples
    few: Samples  # the first of them, to see what is hopeless

    @classmethod
    def from_mesh(
        cls, mesh: Mesh, config: AnnotateSymmetryConfig, rng: np.random.Generator
    ) -> "Shape":
        """Sample `mesh` and bring it to its centroid and unit diameter.

        Raises:
            ValueRangeError: the triangles have no area.
        """
        size = diameter(mesh.vertices[np.unique(mesh.faces)])
        if not mesh.area > MIN_AREA * size**2:
            raise ValueRangeError("area of the mesh", mesh.area, "positive: a surface")
        raw = Surface.from_mesh(mesh, config.num_samples, rng)
        center = raw.points.mean(axis=0)
        surface = raw.normalised(center, size)
        is_sheet = bool(len(surface.rim.points)) and _thickness(surface) < FLAT_SHEET
        if is_sheet:  # all that says where it is, is its rim
            surface = surface.with_walls(WALL_REACH)
        draw = rng.choice(len(raw.points), config.num_verification_samples, replace=False)
        # A card turned in its plane lands beyond its rim, which is what tells it from a disc: of a
        # sheet there is no more beyond the rim, of anything else there may be.
        make = Samples.with_links if len(surface.rim.points) and not is_sheet else Samples
        samples, few = (
            make(surface.points[some], surface.normals[some]) for some in (draw, draw[:FEW_SAMPLES])
        )
        return cls(center, size, surface, samples, few)

    def points(self, count: int) -> Array:
        """Return the first `count` of the samples' points: (count, 3)."""
        return self.samples.points[:count]

    def to_mesh(self, point: Array) -> Array:
        """Return `point` (3,) in the mesh frame, metres."""
        return self.center + self.size * point


def _thickness(surface: Surface) -> float:
    """Return the extent of `surface` across the plane that it lies in most, without strays."""
    height = surface.points @ principal_axes(surface.points)[-1]
    return float(np.ptp(np.percentile(height, [1.0, 99.0])))


def search_planes(
    shape: Shape, grid: DistanceGrid, config: AnnotateSymmetryConfig
) -> tuple[Array, list[Fit]]:
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


def refined_planes(shape: Shape, planes: Array, scales: Sequence[float], count: int) -> Array:
    """Return `planes` (c, 4) after a Gauss-Newton step a scale on `count` samples."""
    points = shape.points(count)
    normals, offsets = refine_planes(shape.surface, points, planes[:, :3], planes[:, 3], scales)
    return np.column_stack([normals, offsets])


def staged_fit(
    shape: Shape, config: AnnotateSymmetryConfig, measure: Callable[[Samples], Fit]
) -> Fit:
    """Return what `measure` finds on all samples, or on few if these say it is hopeless."""
    fit = measure(shape.few)
    return fit if fit.is_hopeless(config) else measure(shape.samples)


def fit_of_plane(shape: Shape, plane: Array, samples: Samples) -> Fit:
    """Measure the plane (4,) on `samples` of the shape."""
    return fit_of(shape.surface, samples, mirrored(samples, plane[:3], float(plane[3])))


def fit_of_turn(shape: Shape, axis: Array, angle: float, samples: Samples) -> Fit:
    """Measure a turn by `angle` radians about the axis (6,) on `samples` of the shape."""
    image = turned(samples, axis[:3], axis[3:], angle)
    return fit_of(shape.surface, samples, image, angle)


def continuous_fit(shape: Shape, axis: Array, config: AnnotateSymmetryConfig) -> tuple[Fit, bool]:
    """Return the worst fit of the axis (6,) over generic angles, and if it is continuous.

    Stops at the first angle that does not hold.
    """
    fits: list[Fit] = []
    for angle in VERIFICATION_ANGLES:
        fits.append(staged_fit(shape, config, partial(fit_of_turn, shape, axis, angle)))
        if fits[-1].ovalness > 1.0 or not fits[-1].holds(config, config.max_axis_mean):
            return fits[-1], False
    return max(fits, key=attrgetter("miss")), are_round(fits)


def search_axes(
    shape: Shape, config: AnnotateSymmetryConfig
) -> tuple[Array, list[tuple[Fit, bool]]]:
    """Return distinct refined axes (c, 6), and (worst fit, is it continuous) of each."""
    axes = revolution_candidates(
        shape.samples.points,
        shape.samples.normals,
        config.axis_candidates,
        np.radians(config.axis_separation_deg),
    )
    axes = refined_axes(shape, axes, REFINEMENT_ANGLES, FINE_SCALES, FINE_SAMPLES)
    fits = [continuous_fit(shape, axis, config) for axis in axes]
    order = np.argsort([fit.loss for fit, _ in fits], kind="stable")
    return axes[order], [fits[index] for index in order]


def refined_axes(
    shape: Shape, axes: Array, angles: Sequence[float], scales: Sequence[float], count: int
) -> Array:
    """Return `axes` (c, 6) after a Gauss-Newton step a scale, turning by `angles` radians."""
    points = shape.points(count)
    parts = refine_axes(shape.surface, points, axes[:, :3], axes[:, 3:], angles, scales)
    return np.column_stack(parts)


def _distinct_planes(shape: Shape, planes: Array) -> Array:
    before = Samples(shape.points(COARSE_SAMPLES), shape.samples.normals[:COARSE_SAMPLES])
    images = [mirrored(before, plane[:3], float(plane[3])).points for plane in planes]
    misses = _misses(shape, np.stack(images))
    order = np.argsort(misses, kind="stable")
    # A plane that misses with half of the surface is none of a region either.
    ranked = planes[order[: max(1, int(np.sum(misses < MAX_MISS)))]]
    return ranked[
        distinct(
            ranked[:, :3], ranked[:, 3], KEPT_PLANES, min_angle=SAME_ANGLE, min_offset=SAME_OFFSET
        )
    ]


def _misses(shape: Shape, images: Array) -> Array:
    """Return the mean capped distance (c,) of `images` (c, n, 3) to the nearest samples."""
    distance = shape.surface.within(images, MISS_CAP)[0]
    return np.asarray(np.minimum(distance, MISS_CAP).mean(axis=-1))
