"""Axes of rotation that a region may have, from its shape and from the network.

An upright object turns about the table's normal, a lying one about a level line at half its height;
a tin of which only the lid is seen turns about the lid's normal, through the middle of its outline.
"""

import cv2
import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ROTATION_SLOT, RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import basis_from_direction, cross
from pipelines.grasping.symmetries.plane_candidates import (
    NETWORK,
    SHAPE,
    axes_of_spread,
    half_between_ends,
    halfway_up,
    largest_face,
    level_directions,
)


def starting_axes(
    slots: SymmetrySlots,
    points: Array,
    normals: Array,
    table: Plane | None,
    allowed: int = NETWORK | SHAPE,
) -> tuple[list[RotationSymmetry], Indices]:
    """Return k axes worth a fit, and their sources (k,); arguments as of `candidate_planes`."""
    named, lines = slots.point[ROTATION_SLOT], []
    if allowed & NETWORK:
        lines.append((slots.direction[ROTATION_SLOT], named, NETWORK))
    if allowed & SHAPE:
        if not allowed & NETWORK:
            named = points.mean(axis=0)
        lines += _from_shape(points, normals, table, named, allowed)
    axes = [RotationSymmetry(direction, point) for direction, point, _ in lines]
    return axes, np.array([source for _, _, source in lines])


def _from_shape(
    points: Array, normals: Array, table: Plane | None, named: Array, through_named: int
) -> list[tuple[Array, Array, int]]:
    """Return direction, point and source of axes by shape, some through the point `named`."""
    face = largest_face(normals)
    lines = [(direction, named, through_named) for direction in axes_of_spread(points).T]
    lines.append((face, middle_of_outline(points, face), SHAPE))
    if table is not None:
        up = table.normal
        lines += [(up, named, through_named), (up, middle_of_outline(points, up), SHAPE)]
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
    """Return direction and point (3,) of an object's axis that lies `along` each on `table`."""
    middle = points.mean(axis=0)
    across = cross(table.normal, np.array(along))
    aside = half_between_ends(points, across) - across @ middle
    rise = float(table.height(halfway_up(points, table)) - table.height(middle))
    through = middle + aside[:, None] * across + rise * table.normal
    return list(zip(along, through, strict=True))
