"""The mean of the symmetries that the points of a region predict (Sec. III-E, D. 4)."""

import numpy as np

from pipelines.array_types import Array, Floats
from pipelines.geometry.symmetry import SPHERE_SLOT, SymmetrySlots


def mean_slots(existence: Floats, point: Floats, direction: Floats) -> SymmetrySlots:
    """Return the mean of the symmetries that n points of a region predict.

    A normal and its opposite are one plane, so directions average as outer products.

    Args:
        existence: (n, 5) probabilities.
        point: (n, 5, 3) metres.
        direction: (n, 5, 3) unit; the sphere's is ignored.
    """
    slots = SymmetrySlots.of((), "network")
    slots.probability[:], slots.point[:] = existence.mean(axis=0), point.mean(axis=0)
    flat = direction.reshape(len(direction), -1)  # transposed below: contiguous coordinates
    by_slot = np.ascontiguousarray(flat.T, np.float64).reshape(*direction.shape[1:], -1)
    slots.direction[:SPHERE_SLOT] = _leading_directions(by_slot[:SPHERE_SLOT])
    return slots


def _leading_directions(directions: Array) -> Array:
    """Return the mean axes (s, 3), unit, of `directions` (s, 3, n), independent of their signs."""
    scatter = (directions * (1 / directions.shape[2])) @ directions.swapaxes(1, 2)
    axes: Array = np.linalg.eigh(scatter)[1][..., 2]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1, keepdims=True), axis=1)
    return np.where(largest > 0, axes, -axes)
