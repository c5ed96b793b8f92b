"""Axes of rotation that a region may have, from its shape and from the network.

Any object may turn about an axis of its points' spread; an upright one turns about the table's
normal, and through the middle of its outline where only its lid is seen.
"""

import cv2
import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import ROTATION_SLOT, RotationSymmetry, SymmetrySlots
from pipelines.geometry.transforms import basis_from_direction
from pipelines.grasping.symmetries.plane_candidates import axes_of_spread
from pipelines.grasping.symmetries.sources import NETWORK, SHAPE


def starting_axes(
    slots: SymmetrySlots,
    points: Array,
    table: Plane | None,
    allowed: int = NETWORK | SHAPE,
) -> tuple[list[RotationSymmetry], Indices]:
    """Return k axes worth a fit, and their sources (k,).

    Args:
        slots: predicted for the region, camera frame.
        points: (n, 3) metres, camera frame.
        table: normal toward the camera; None where none is known.
        allowed: sources to look at.
    """
    named, lines = slots.point[ROTATION_SLOT], []
    if allowed & NETWORK:
        lines.append((slots.direction[ROTATION_SLOT], named, NETWORK))
    if allowed & SHAPE:
        if not allowed & NETWORK:
            named = points.mean(axis=0)
        lines += _from_shape(points, table, named, allowed)
    axes = [RotationSymmetry(direction, point) for direction, point, _ in lines]
    return axes, np.array([source for _, _, source in lines])


def _from_shape(
    points: Array, table: Plane | None, named: Array, through_named: int
) -> list[tuple[Array, Array, int]]:
    """Return direction, point and source of axes by shape, some through the point `named`."""
    lines = [(direction, named, through_named) for direction in axes_of_spread(points).T]
    if table is not None:
        up = table.normal
        lines += [(up, named, through_named), (up, middle_of_outline(points, up), SHAPE)]
    return lines


def middle_of_outline(points: Array, direction: Array) -> Array:
    """Return the centre (3,) of the smallest circle around `points` as seen along `direction`."""
    basis, middle = basis_from_direction(direction)[:, 1:], points.mean(axis=0)
    flat = (points - middle) @ basis
    centre, _ = cv2.minEnclosingCircle(flat.astype(np.float32))
    return np.asarray(middle + basis @ np.array(centre, np.float64))
