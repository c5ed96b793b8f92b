"""One set of symmetry slots of the votes of many points (Sec. III-E, D. 4)."""

import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.symmetry import REFLECTION_SLOTS, SPHERE_SLOT, SymmetrySlots


def mean_slots(existence: Array, point: Array, direction: Array) -> SymmetrySlots:
    """Return the plain mean of per-point predictions, as Sec. III-E has it.

    A normal and its opposite are one plane, so directions average as outer products; shapes as in
    `voted_slots`.
    """
    slots, same = SymmetrySlots.empty(), np.full((SPHERE_SLOT, len(existence)), 1 / len(existence))
    slots.existence[:], slots.point[:] = existence.mean(axis=0), point.mean(axis=0)
    slots.direction[:SPHERE_SLOT] = leading_directions(_by_slot(direction)[:SPHERE_SLOT], same)
    return slots


def voted_slots(
    existence: Array, point: Array, direction: Array, affordance: Array
) -> SymmetrySlots:
    """Return the average of per-point predictions, weighed by affordance.

    A normal and its opposite are one plane, so directions average as the leading eigenvector of
    the sum of their outer products; points as the weighted median, moved along the direction to
    the weighted median plane.

    Args:
        existence: (n, 5) probabilities.
        point: (n, 5, 3) metres.
        direction: (n, 5, 3) unit; that of the sphere is not looked at.
        affordance: (n,).
    """
    weight = np.maximum(np.asarray(affordance, np.float64), 0.0)
    weight = weight / weight.sum() if weight.sum() > 0 else np.full(len(weight), 1 / len(weight))
    slots = SymmetrySlots.empty()
    slots.existence[:] = weight @ existence
    vote = (weight[:, None] * existence).T  # (5, n)
    vote = np.where(vote.sum(axis=1, keepdims=True) > 0, vote, weight)
    points, directions = _by_slot(point), _by_slot(direction)[:SPHERE_SLOT]
    slots.point[:] = weighted_medians(points, vote[:, None])
    axes = leading_directions(directions, vote[:SPHERE_SLOT])
    slots.direction[:SPHERE_SLOT] = axes
    planes = slice(len(REFLECTION_SLOTS))
    normals = axes[planes]
    along = (normals[:, None] @ points[planes])[:, 0]  # (3, n)
    offset = weighted_medians(along, vote[planes])
    offset -= np.einsum("si,si->s", slots.point[planes], normals)
    slots.point[planes] += offset[:, None] * normals
    return slots


def _by_slot(vectors: Array) -> Array:
    """Return (5, 3, n) of (n, 5, 3), a coordinate in one piece."""
    flat = vectors.reshape(len(vectors), -1)
    return np.ascontiguousarray(flat.T, np.float64).reshape(*vectors.shape[1:], len(vectors))


def leading_directions(directions: Array, weight: Array) -> Array:
    """Return the unit axes (s, 3) of `directions` (s, 3, n), whose signs do not matter.

    `weight`: (s, n).
    """
    scatter = (weight[:, None] * directions) @ directions.swapaxes(1, 2)
    axes: Array = np.linalg.eigh(scatter)[1][..., 2]
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1, keepdims=True), axis=1)
    return np.where(largest > 0, axes, -axes)


def weighted_medians(values: Array, weight: Array) -> Array:
    """Return the smallest (...) of `values` (..., n) that half of `weight` does not exceed.

    `weight`: (..., n) too, or broadcast to that.
    """
    rows = np.ascontiguousarray(values, np.float64).reshape(-1, values.shape[-1])
    weights = np.ascontiguousarray(np.broadcast_to(weight, values.shape), np.float64)
    # Equal values are one value, whichever comes first.
    halfway = _halfway(rows, np.argsort(rows), weights.reshape(rows.shape))
    return halfway.reshape(values.shape[:-1])


@compiled
def _halfway(values: Array, order: Indices, weight: Array) -> Array:
    """Return (m,) which of `values`, in ascending `order`, half of `weight` reaches.

    All are (m, n).
    """
    halfway = np.empty(len(values))
    for m in range(len(values)):
        total, gathered, n = 0.0, 0.0, 0
        for k in range(values.shape[1]):
            total += weight[m, order[m, k]]
        while gathered + weight[m, order[m, n]] < 0.5 * total:
            gathered += weight[m, order[m, n]]
            n += 1
        halfway[m] = values[m, order[m, n]]
    return halfway
