"""Of alike grasps only the best, so that the next one is another (D. 78)."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipelines.grasping.grasps import Grasps

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

HALF_TURN = np.array([1.0, -1.0, -1.0])  # about the approach: the fingers change places
ROUNDING = 1e-6  # radians; the angles that hands are turned by are no ties


def non_maximum_suppression(
    grasps: Grasps, distance: float, angle: float, sound: Callable[[Grasps], Mask]
) -> Indices:
    """Return the indices of `grasps`, best first, that are sound and differ from all better ones.

    A grasp goes if a better one that stays is nearer than `distance` metres, contacts' middle to
    contacts' middle, and turned by less than `angle` radians from it, the fingers swapped or not.
    What is `sound` is asked about few: the rest goes whatever the answer would be.
    """
    near = are_near(grasps, distance, angle)
    left, asked = np.ones(len(grasps), np.bool_), np.zeros(len(grasps), np.bool_)
    while True:
        first = _greedy(near, left)
        unknown = first[~asked[first]]
        if not len(unknown):
            return first
        # What an unsound one stood before may come up now, and is asked about in the next round.
        left[unknown] = sound(grasps[unknown])
        asked[unknown] = True


def are_near(grasps: Grasps, distance: float, angle: float) -> Mask:
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
