"""The symmetries of a region, the mean of those that its points predict (Sec. III-E, D. 4)."""

import numpy as np

from pipelines.array_types import Array, Floats
from pipelines.geometry.symmetry import SPHERE_SLOT, SymmetrySlots


def mean_slots(existence: Floats, point: Floats, direction: Floats) -> SymmetrySlots:
    """Return the mean of per-point predictions.

    A normal and its opposite are one plane, so directions average as outer products.

    Args:
        existence: (n, 5) probabilities.
        point: (n, 5, 3) metres.
        direction: (n, 5, 3) unit; that of the sphere is not looked at.
    """
    slots = SymmetrySlots.of((), "network")
    slots.existence[:], slots.point[:] = existence.mean(axis=0), point.mean(axis=0)
    slots.direction[:SPHERE_SLOT] = _leading_directions(_by_slot(direction)[:SPHERE_SLOT])
    return slots


def _by_slot(vectors: Floats) -> Array:
    """Return (5, 3, n) of (n, 5, 3), a coordinate in one piece."""
    flat = vectors.reshape(len(vectors), -1)
    return np.ascontiguousarray(flat.T, np.float64).reshape(*vectors.shape[1:], len(vectors))


def _leading_directions(directions: Array) -> Array:
    """Return the unit axes (s, 3) of `directions` (s, 3, n), whose signs do not matter."""
    scatter = (directions * (1 / directions.shape[2])) @ directions.swapaxes(1, 2)
    axes: Array = np.linalg.eigh(scatter)[1][..., 2]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1, keepdims=True), axis=1)
    return np.where(largest > 0, axes, -axes)
