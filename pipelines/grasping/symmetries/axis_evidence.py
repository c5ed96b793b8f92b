"""Rotation axis and sphere of a region: fitted to the seen surface, selected by a critic (D. 148).

A surface of revolution equals its mirror image in every plane through its axis. The plane through
the axis and the line of sight maps seen surface to seen surface, so the images show whether the
axis is right. A sphere is scored as an upright axis through its centre. The axis critic, a
`PointCritic`, turns this evidence into a probability.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Singles
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.geometry.symmetry import (
    ROTATION_SLOT,
    SPHERE_SLOT,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
)
from pipelines.geometry.symmetry_fitting import fit_rotations, fit_sphere
from pipelines.geometry.transforms import basis_from_direction, cross, rotation_about, unit
from pipelines.grasping.critics.point_critic import PointCritic
from pipelines.grasping.symmetries import mirror_views
from pipelines.grasping.symmetries.axis_candidates import starting_axes
from pipelines.grasping.symmetries.mirror_views import MirrorImages, PlanePointFeature
from pipelines.grasping.symmetries.observed_frustum import in_observed_frustum
from pipelines.grasping.symmetries.plane_evidence import SAME_FIT
from pipelines.grasping.symmetries.region_evidence import RegionEvidence
from pipelines.grasping.symmetries.region_shape import ENDS
from pipelines.grasping.symmetries.sources import NETWORK, SHAPE

# All chosen by eye; the shipped weights were trained with these values.
STRIDE = 4  # every STRIDE-th point is turned about each axis
TURNS = np.radians([60.0, 120.0, 180.0, 240.0, 300.0])
FACING_CAMERA = 0.05  # sine between axis and line of sight below which any plane may be taken
THINNEST = 1e-4  # metres from the axis; nearer points have no radial direction

# Of the plane through the axis and the line of sight, whose up is the axis; then the parts of the
# surface normal away from the axis and around it. On a surface of revolution the last is zero.
POINT_FEATURES = (*mirror_views.POINT_FEATURES, "normal_radial", "normal_tangential")
TANGENTIAL = len(POINT_FEATURES) - 1
# Cosines between the axis and up, the axis and the view, the view and up; 1 for a sphere.
AXIS_FEATURES = ("axis_up", "axis_view", "view_up", "is_sphere")
FEATURES = (
    "existence",  # of the network, before the fit
    "support",  # share of the seen surface that the fit explains
    "consistency",  # share of turned points on or behind the observed surface
    "off_middle",  # distance to the middle of the outline, in half widths of the outline
    "length",  # extent of the region along the axis, decimetres
    "radius",  # distance of the farthest points from the axis, decimetres
)


@dataclass(frozen=True)
class FittedAxes:
    """The k - 1 fitted axes of a region and, last of k, its fitted sphere. Camera frame.

    Attributes:
        axes: the k - 1 axes.
        sphere: the last candidate.
        shares: (k, 3), 0 to 1: existence, support and consistency of `FEATURES`.
        sources: (k,) bits `NETWORK` and `SHAPE`.
    """

    axes: list[RotationSymmetry]
    sphere: SphereSymmetry
    shares: Array
    sources: Indices

    @property
    def symmetries(self) -> list[RotationSymmetry | SphereSymmetry]:
        """All k candidates."""
        return [*self.axes, self.sphere]


def likely_axis_and_sphere(
    region: RegionEvidence, critic: PointCritic
) -> tuple[tuple[RotationSymmetry, float, int], tuple[SphereSymmetry, float, int]]:
    """Return the most likely axis, and the sphere, each with its confidence and its source."""
    fitted = fitted_axes(region)
    confidence = critic.probability(*axis_critic_inputs(fitted, region))
    chosen = int(confidence[:-1].argmax())
    best = fitted.axes[chosen]
    alike = [_are_one(best, each) for each in fitted.axes]
    source = int(np.bitwise_or.reduce(fitted.sources[:-1][alike]))
    of_sphere = float(confidence[-1]), int(fitted.sources[-1])
    return (best, float(confidence[chosen]), source), (fitted.sphere, *of_sphere)


def _are_one(first: RotationSymmetry, second: RotationSymmetry) -> bool:
    """Return whether two axes of a region are the same line."""
    angle, offset = SAME_FIT
    away = np.linalg.norm(cross(second.point - first.point, first.axis))
    return bool(abs(first.axis @ second.axis) > np.cos(angle) and away < offset)


def fitted_axes(region: RegionEvidence) -> FittedAxes:
    """Return all candidate axes and the sphere, fitted to the points of `region`."""
    starts, sources = starting_axes(region)
    fits = fit_rotations(starts, region.points, region.normals)
    axes, feet = np.array([fit.direction for fit in fits]), np.array([fit.point for fit in fits])
    images = _turned(region.points[::STRIDE], axes, feet)
    free = in_observed_frustum(images.reshape(-1, 3), region.scene).reshape(images.shape[:-1])
    existence = np.full(len(fits), region.slots.probability[ROTATION_SLOT])
    support = np.array([fit.support for fit in fits])
    shares = np.stack([existence, support, free.mean(axis=(0, 2))], axis=1)
    sphere, of_sphere, source = _fitted_sphere(region)
    found = [RotationSymmetry(*each) for each in zip(axes, feet, strict=True)]
    return FittedAxes(found, sphere, np.vstack([shares, of_sphere]), np.append(sources, source))


def _turned(points: Array, axes: Array, feet: Array) -> Array:
    """Return `points` (n, 3) turned by `TURNS` about `axes` through `feet` (k, 3): (n, k, t, 3)."""
    turns = rotation_about(axes[:, None], TURNS)  # (k, t, 3, 3)
    shift = feet[:, None] - np.einsum("ktij,kj->kti", turns, feet)
    return np.asarray((points @ turns.reshape(-1, 3).T).reshape(-1, *shift.shape) + shift)


def _fitted_sphere(region: RegionEvidence) -> tuple[SphereSymmetry, list[float], int]:
    """Return the network's sphere, fitted to the points, with its shares and its source.

    Without the network, the fit starts in the middle of the points.
    """
    by_network = bool(region.allowed & NETWORK)
    start = region.slots.point[SPHERE_SLOT] if by_network else region.points.mean(axis=0)
    fit = fit_sphere(start, region.points, region.normals)
    sphere = SphereSymmetry(fit.point)
    free = in_observed_frustum(sphere.counterpart(region.points), region.scene)
    existence = float(region.slots.probability[SPHERE_SLOT])
    return sphere, [existence, fit.support, float(free.mean())], NETWORK if by_network else SHAPE


def axis_critic_inputs(
    fitted: FittedAxes, region: RegionEvidence
) -> tuple[Singles, Singles, Singles]:
    """Return the axis critic's features of k candidates: (k, 128, 16), (k, 4) and (k, 6)."""
    axis, foot = _lines(fitted, region)
    frames = _frames(axis, foot)
    planes = [ReflectionSymmetry(*each) for each in zip(frames[:, 0], foot, strict=True)]
    mirrored = MirrorImages.of(planes, region.points, region.normals)
    rows = mirrored.features(frames, foot, region.mask, region.scene)
    columns = [*fitted.shares.T, *_sizes(axis, foot, mirrored)]
    return (
        np.concatenate([rows, _around(rows)], axis=2),
        _angles(axis, region),
        np.stack(columns, axis=1).astype(np.float32),
    )


def _lines(fitted: FittedAxes, region: RegionEvidence) -> tuple[Array, Array]:
    """Return the direction (k, 3) of each axis and its point (k, 3) nearest to the region's middle.

    The axis of a sphere is upright through its centre. Axes point to the longer end of the region.
    """
    axis = np.array([*(each.axis for each in fitted.axes), region.scene.up])
    point, middle = np.array([each.point for each in fitted.symmetries]), region.points.mean(axis=0)
    foot = point + np.einsum("ki,ki->k", middle - point, axis)[:, None] * axis
    foot[-1] = fitted.sphere.point
    beyond = np.median(region.points @ axis.T, axis=0) > np.einsum("ki,ki->k", foot, axis)
    return np.where(beyond, 1.0, -1.0)[:, None] * axis, foot


def _frames(axis: Array, foot: Array) -> Array:
    """Return the normal of the plane of axis and line of sight, the axis, and across: (k, 3, 3)."""
    sight = foot - np.einsum("ki,ki->k", foot, axis)[:, None] * axis
    faced = np.linalg.norm(sight, axis=1) > FACING_CAMERA * np.linalg.norm(foot, axis=1)
    away = unit(np.where(faced[:, None], sight, basis_from_direction(axis)[..., 1]))
    normal = cross(axis, away)
    return np.stack([normal, axis, cross(normal, axis)], axis=1)


def _around(rows: Singles) -> Singles:
    """Return the parts (k, 128, 2) of the normals away from the axis and around it."""
    x, z = rows[..., PlanePointFeature.ALONG_NORMAL], rows[..., PlanePointFeature.ALONG_ACROSS]
    nx, nz = rows[..., PlanePointFeature.NORMAL_NORMAL], rows[..., PlanePointFeature.NORMAL_ACROSS]
    radius = np.maximum(np.hypot(x, z), np.float32(mirror_views.LENGTH_SCALE * THINNEST))
    return np.stack([(nx * x + nz * z) / radius, (nx * z - nz * x) / radius], axis=2)


def _angles(axis: Array, region: RegionEvidence) -> Singles:
    """Return the `AXIS_FEATURES` (k, 4)."""
    ray, table = unit(region.points.mean(axis=0)), region.scene.plane
    up = np.zeros(3) if table is None else table.normal
    is_sphere = np.arange(len(axis)) == len(axis) - 1
    columns = [np.abs(axis @ up), np.abs(axis @ ray), np.full(len(axis), ray @ up), is_sphere]
    return np.stack(columns, axis=1).astype(np.float32)


def _sizes(axis: Array, foot: Array, mirrored: MirrorImages) -> list[Array]:
    """Return the last three of `FEATURES`, each (k,)."""
    along = quantiles(axis @ mirrored.points.T, ENDS)  # (k, 2)
    apart = np.linalg.norm(cross(mirrored.points - foot[:, None], axis[:, None]), axis=2)
    return [
        mirrored.off_middle,
        mirror_views.LENGTH_SCALE * (along[:, 1] - along[:, 0]),
        mirror_views.LENGTH_SCALE * quantiles(apart, ENDS[1:])[:, 0],
    ]
