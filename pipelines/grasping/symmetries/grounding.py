"""Predicted symmetries fitted to the seen surface, with the confidence in each (D. 31).

The network predicts a region's symmetries roughly. The measured points determine them exactly, and
whether they exist: a true symmetry maps the seen surface onto or behind seen surface, never into
observed free space.
"""

from dataclasses import dataclass
from typing import Generic, TypeVar

import cv2
import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.configs.planning import SymmetrySource
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ROTATION_SLOT,
    SPHERE_SLOT,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
    SymmetrySlots,
)
from pipelines.geometry.symmetry_fitting import fit_rotations, fit_sphere
from pipelines.geometry.transforms import basis_from_direction, cross, rotation_about
from pipelines.grasping.ranking.point_critic import PointCritic
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.grasping.symmetries.axis_critic import AxisCritic
from pipelines.grasping.symmetries.observed_frustum import in_observed_frustum
from pipelines.grasping.symmetries.plane_candidates import (
    NETWORK,
    SHAPE,
    axes_of_spread,
    half_between_ends,
    halfway_up,
    largest_face,
    level_directions,
)
from pipelines.grasping.symmetries.plane_evidence import SAME_FIT, RegionEvidence, likely_planes

NUM_POINTS = 400  # of the region for fits; chosen by eye, as the next two
STRIDE = 4  # every STRIDE-th of these points is turned about each axis
TURNS = np.radians([60.0, 120.0, 180.0, 240.0, 300.0])
SOURCE_NAMES = ("", "network", "shape", "both")  # by the bits of a candidate's sources
SOURCE_BITS: dict[SymmetrySource, int] = {
    "network": NETWORK,
    "shape": SHAPE,
    "network+shape": NETWORK | SHAPE,
}

Fitted = TypeVar("Fitted", RotationSymmetry, SphereSymmetry)


@dataclass(frozen=True)
class SymmetryCritics:
    """The critics of fitted symmetries: of axes and spheres, and of mirror planes."""

    axes: AxisCritic
    planes: PointCritic


@dataclass(frozen=True)
class Evidence(Generic[Fitted]):
    """k fitted axes or spheres of a region, and the evidence for each.

    Attributes:
        symmetries: k of one kind, camera frame.
        rows: (k, 3), 0 to 1: the network's existence; the share of the seen surface that the fit
            explains; the share of images on or behind the observed surface.
        sources: (k,) bits `NETWORK` and `SHAPE`.
    """

    symmetries: list[Fitted]
    rows: Array
    sources: Indices

    def best(self, critic: AxisCritic) -> tuple[Fitted, float, int]:
        """Return the most likely symmetry, its confidence and its sources."""
        kind = self.symmetries[0].kind
        chosen = int(critic.log_odds(kind, self.rows).argmax())
        best = self.symmetries[chosen]
        alike = [_are_one(best, each) for each in self.symmetries]
        source = int(np.bitwise_or.reduce(self.sources[alike]))
        return best, float(critic.probability(kind, self.rows[chosen])), source


def _are_one(first: Fitted, second: Fitted) -> bool:
    """Return whether two axes of a region are the same line; spheres of a region are the same."""
    if isinstance(first, SphereSymmetry) or isinstance(second, SphereSymmetry):
        return first is second
    angle, offset = SAME_FIT
    away = np.linalg.norm(cross(second.point - first.point, first.axis))
    return bool(abs(first.axis @ second.axis) > np.cos(angle) and away < offset)


def ground_symmetries(
    slots: SymmetrySlots,
    region: RegionCloud,
    scene: SceneCloud,
    critics: SymmetryCritics,
    candidates: SymmetrySource = "network+shape",
) -> SymmetrySlots:
    """Return the predicted `slots` fitted to `region`, with the confidence in each.

    Planes are ordered by confidence and may move to other slots.
    """
    allowed = SOURCE_BITS[candidates]
    points, normals = fitted_points(region)
    axis = axis_evidence(slots, points, normals, scene, allowed).best(critics.axes)
    sphere = sphere_evidence(slots, points, normals, scene, allowed).best(critics.axes)
    evidence = RegionEvidence(slots, axis[0], points, normals, region.mask, scene, allowed)
    planes = likely_planes(evidence, critics.planes)
    fitted: list[tuple[int, Symmetry, float, int]] = [
        (slot, *plane) for slot, plane in zip(REFLECTION_SLOTS, planes, strict=False)
    ]
    fitted += [(ROTATION_SLOT, *axis), (SPHERE_SLOT, *sphere)]
    found = SymmetrySlots.of(each[:3] for each in fitted)
    for slot, _, _, source in fitted:
        found.source[slot] = SOURCE_NAMES[source]
    return found


def fitted_points(region: RegionCloud) -> tuple[Array, Array]:
    """Return the points (n, 3) of `region` that symmetries are fitted to, and their normals."""
    step = max(1, len(region) // NUM_POINTS)
    return region.points[::step].copy(), region.normals[::step].copy()


def axis_evidence(
    slots: SymmetrySlots,
    points: Array,
    normals: Array,
    scene: SceneCloud,
    allowed: int = NETWORK | SHAPE,
) -> Evidence[RotationSymmetry]:
    """Return all candidate axes, fitted to `points` (n, 3) with `normals` (n, 3)."""
    starts, sources = starting_axes(slots, points, normals, scene.plane, allowed)
    fits = fit_rotations(starts, points, normals)
    axes, feet = np.array([fit.direction for fit in fits]), np.array([fit.point for fit in fits])
    images = _turned(points[::STRIDE], axes, feet)
    free = in_observed_frustum(images.reshape(-1, 3), scene).reshape(images.shape[:-1])
    existence = np.full(len(fits), slots.probability[ROTATION_SLOT])
    support = np.array([fit.support for fit in fits])
    rows = np.stack([existence, support, free.mean(axis=(0, 2))], axis=1)
    symmetries = [RotationSymmetry(*each) for each in zip(axes, feet, strict=True)]
    return Evidence(symmetries, rows, sources)


def starting_axes(
    slots: SymmetrySlots,
    points: Array,
    normals: Array,
    table: Plane | None,
    allowed: int = NETWORK | SHAPE,
) -> tuple[list[RotationSymmetry], Indices]:
    """Return k axes to fit, and their sources (k,); arguments as in `candidate_planes`.

    The axis of an upright object is the table's normal, the axis of a lying object a level line at
    half its height. If only the lid of a tin is seen, the axis is the lid's normal through the
    middle of its outline.
    """
    by_network = bool(allowed & NETWORK)
    anchor, lines = slots.point[ROTATION_SLOT] if by_network else points.mean(axis=0), []
    if by_network:
        lines.append((slots.direction[ROTATION_SLOT], anchor, NETWORK))
    if allowed & SHAPE:
        lines += _axes_from_shape(points, normals, table, anchor, allowed)
    axes = [RotationSymmetry(direction, point) for direction, point, _ in lines]
    return axes, np.array([source for _, _, source in lines])


def _axes_from_shape(
    points: Array, normals: Array, table: Plane | None, anchor: Array, anchored: int
) -> list[tuple[Array, Array, int]]:
    """Return direction, point and source of axes by shape.

    Axes through the point `anchor` (3,), the network's if it is allowed, have sources `anchored`.
    """
    face = largest_face(normals)
    lines = [(direction, anchor, anchored) for direction in axes_of_spread(points).T]
    lines.append((face, middle_of_outline(points, face), SHAPE))
    if table is not None:
        up = table.normal
        lines += [(up, anchor, anchored), (up, middle_of_outline(points, up), SHAPE)]
        along = level_directions(points, table)
        lines += [(*line, SHAPE) for line in _lying(points, along, table)]
    return lines


def middle_of_outline(points: Array, direction: Array) -> Array:
    """Return the centre (3,) of the smallest circle around `points` as seen along `direction`."""
    basis, middle = basis_from_direction(direction)[:, 1:], points.mean(axis=0)
    flat = (points - middle) @ basis
    centre, _ = cv2.minEnclosingCircle(flat.astype(np.float32))
    return np.asarray(middle + basis @ np.array(centre, np.float64))


def _lying(points: Array, along: list[Array], table: Plane) -> list[tuple[Array, Array]]:
    """Return direction and point (3,) of the axis of an object on `table`, for each of `along`."""
    middle = points.mean(axis=0)
    across = cross(table.normal, np.array(along))
    aside = half_between_ends(points, across) - across @ middle
    rise = float(table.height(halfway_up(points, table)) - table.height(middle))
    through = middle + aside[:, None] * across + rise * table.normal
    return list(zip(along, through, strict=True))


def _turned(points: Array, axes: Array, feet: Array) -> Array:
    """Return `points` (n, 3) turned by `TURNS` about `axes` through `feet` (k, 3): (n, k, t, 3)."""
    turns = rotation_about(axes[:, None], TURNS)  # (k, t, 3, 3)
    shift = feet[:, None] - np.einsum("ktij,kj->kti", turns, feet)
    return np.asarray((points @ turns.reshape(-1, 3).T).reshape(-1, *shift.shape) + shift)


def sphere_evidence(
    slots: SymmetrySlots,
    points: Array,
    normals: Array,
    scene: SceneCloud,
    allowed: int = NETWORK | SHAPE,
) -> Evidence[SphereSymmetry]:
    """Return the network's sphere, fitted to `points` (n, 3) with `normals` (n, 3).

    Without the network, the fit starts in the middle of the points.
    """
    by_network = bool(allowed & NETWORK)
    start = slots.point[SPHERE_SLOT] if by_network else points.mean(axis=0)
    fit = fit_sphere(start, points, normals)
    sphere = SphereSymmetry(fit.point)
    free = in_observed_frustum(sphere.counterpart(points), scene)
    existence = float(slots.probability[SPHERE_SLOT])
    row = np.array([[existence, fit.support, free.mean()]])
    return Evidence([sphere], row, np.array([NETWORK if by_network else SHAPE]))
