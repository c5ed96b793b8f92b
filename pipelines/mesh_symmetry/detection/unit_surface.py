"""A mesh's surface in normalised coordinates, and the fits of planes and turns to it.

Normalised coordinates: origin at the surface's centroid, unit diameter. Planes are rows
(nx, ny, nz, d) of n.x = d, axes rows (ux, uy, uz, px, py, pz).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.errors import ValueRangeError
from pipelines.geometry.meshes.diameter import diameter
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.mesh_symmetry.detection.nearly_round import (
    bend_of,
    bent_fits,
    is_nearly_round,
    leans_in_pattern,
)
from pipelines.mesh_symmetry.detection.symmetry_candidates import principal_axis_rows
from pipelines.mesh_symmetry.detection.symmetry_verification import (
    VERIFICATION_ANGLES,
    Samples,
    SurfaceFit,
    are_round,
    fit_of,
    mirror_samples,
    normals_agree,
    turn_samples,
)
from pipelines.mesh_symmetry.surface.sampled_surface import Surface

FEW_SAMPLES = 400  # to reject hopeless candidates
FLAT_SHEET = 0.01  # of the diameter; largest thickness of a sheet with open rims
THIN_PLATE = 0.04  # of the diameter; largest thickness of a plate whose walls get more samples
WALL_SHARE = 0.3  # of the samples of a thin plate, on its walls
WALL_COSINE = 0.5  # largest cosine between the normal of a wall and the thin axis
WALL_REACH = 0.05  # of the diameter, the error of candidates; nearer samples represent the rim
MIN_AREA = 1e-9  # of the squared diameter; a mesh of less area is points or a line


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
