"""Candidate rotation axes of a region, from its shape and from the network, not yet scored.

The axis of an upright object is the table's normal, the axis of a lying object a level line at half
its height. If only the lid of a tin is seen, the axis is the lid's normal through the middle of its
outline.
"""

import cv2
import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ROTATION_SLOT, RotationSymmetry
from pipelines.geometry.transforms import basis_from_direction, cross
from pipelines.grasping.symmetries.region_evidence import RegionEvidence
from pipelines.grasping.symmetries.region_shape import (
    axes_of_spread,
    half_between_ends,
    halfway_up,
    largest_face,
    level_directions,
)
from pipelines.grasping.symmetries.sources import NETWORK, SHAPE


def starting_axes(region: RegionEvidence) -> tuple[list[RotationSymmetry], Indices]:
    """Return k axes to fit, camera frame, and their sources (k,), bits `NETWORK` and `SHAPE`."""
    slots, by_network = region.slots, bool(region.allowed & NETWORK)
    anchor = slots.point[ROTATION_SLOT] if by_network else region.points.mean(axis=0)
    lines = [(slots.direction[ROTATION_SLOT], anchor, NETWORK)] if by_network else []
    if region.allowed & SHAPE:
        lines += _axes_from_shape(region, anchor)
    axes = [RotationSymmetry(direction, point) for direction, point, _ in lines]
    return axes, np.array([source for _, _, source in lines])


def _axes_from_shape(region: RegionEvidence, anchor: Array) -> list[tuple[Array, Array, int]]:
    """Return direction, point and source of axes by shape.

    Axes through the point `anchor` (3,), the network's if it is allowed, have all allowed sources.
    """
    points, table, anchored = region.points, region.scene.plane, region.allowed
    face = largest_face(region.normals)
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
    center, _ = cv2.minEnclosingCircle(flat.astype(np.float32))
    return np.asarray(middle + basis @ np.array(center, np.float64))


def _lying(points: Array, along: list[Array], table: Plane) -> list[tuple[Array, Array]]:
    """Return direction and point (3,) of the axis of an object on `table`, for each of `along`."""
    middle = points.mean(axis=0)
    across = cross(table.normal, np.array(along))
    aside = half_between_ends(points, across) - across @ middle
    rise = float(table.height(halfway_up(points, table)) - table.height(middle))
    through = middle + aside[:, None] * across + rise * table.normal
    return list(zip(along, through, strict=True))
