"""Non-maximum suppression: of alike grasps only the best stays (D. 78)."""

from collections.abc import Callable

import numpy as np

from pipelines.array_types import Indices, Mask
from pipelines.grasping.grasps import GraspPoses

HALF_TURN = np.array([1.0, -1.0, -1.0])  # about the approach: the fingers change places
ROUNDING = 1e-6  # radians; two approach angles exactly as far apart as the limit are not alike


def non_maximum_suppression(
    grasps: GraspPoses,
    distance: float,
    angle: float,
    sound: Callable[[GraspPoses], Mask | bool] = lambda _some: True,
) -> Indices:
    """Return the indices of `grasps`, best first, that are sound and differ from all better ones.

    A grasp goes if a better one that stays is nearer than `distance` metres, contacts' middle to
    contacts' middle, and turned by less than `angle` radians from it, the fingers swapped or not.
    `sound` is called for few grasps: the others are suppressed whatever its answer would be.
    """
    near = are_near(grasps, distance, angle)
    left, checked = np.ones(len(grasps), np.bool_), np.zeros(len(grasps), np.bool_)
    while True:
        first = _greedy(near, left)
        unknown = first[~checked[first]]
        if not len(unknown):
            return first
        # Grasps that an unsound one suppressed may stay now, and are checked in the next round.
        left[unknown] = sound(grasps[unknown])
        checked[unknown] = True


def are_near(grasps: GraspPoses, distance: float, angle: float) -> Mask:
    """Return (n, n) which are nearer than `distance` and turned by less than `angle` radians."""
    R = grasps.rotation.reshape(-1, 9)
    swapped = (grasps.rotation * HALF_TURN).reshape(-1, 9)
    trace = np.maximum(R @ R.T, R @ swapped.T)  # 1 + 2 cos(angle)
    x, y, z = (np.subtract.outer(places, places) for places in grasps.translation.T)
    alike = trace > 1.0 + 2.0 * np.cos(angle - ROUNDING)
    return np.asarray(alike & (x * x + y * y + z * z < distance**2))


def _greedy(near: Mask, left: Mask) -> Indices:
    """Return those of `left` (n,) that are not `near` (n, n) an earlier one returned."""
    free, kept = left.copy(), []
    for index in range(len(free)):
        if free[index]:
            kept.append(index)
            free &= ~near[index]
    return np.array(kept, np.int64)
