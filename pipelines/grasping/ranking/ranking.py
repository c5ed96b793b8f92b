"""The ranking of feasible grasps: by Eq. 8, or by the quality that a critic expects (D. 82).

Of alike grasps only the best stays: non-maximum suppression (D. 78).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import RankingConfig
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.grasp_features import GraspFeatures
from pipelines.grasping.ranking.point_critic import PointCritic

HALF_TURN = np.array([1.0, -1.0, -1.0])  # about the approach: the fingers change places
ROUNDING = 1e-6  # radians; two approach angles exactly as far apart as the limit are not alike

Critic = Callable[[GraspFeatures], Array]  # the quality (k,) to expect of k grasps, 0 to 1


def expected_quality(network: PointCritic, features: GraspFeatures) -> Array:
    """Return what the network of `symgrasp train-critic grasps` expects; with it, a `Critic`."""
    candidates = features.candidates()
    return network.probability(features.points(), candidates[:, :0], candidates)


def seen_score(found: RankedGrasps, visible: Array, config: RankingConfig) -> Array:
    """Return s of Eq. 8 (n,), less where the camera does not see.

    Eq. 8 knows the seen points alone. The object's own far side may lie in space that is not seen,
    so the score counts by the share `visible` (n,) of the finger tips' space that is seen to be
    free (D. 68).
    """
    s = eq8_score(found.clearance, found.enclosed_height, config)
    return np.asarray(s * (1.0 - config.weight_unseen * (1.0 - visible)))


def eq8_score(clearance: ArrayLike, enclosed_height: ArrayLike, config: RankingConfig) -> Array:
    """Return s of Eq. 8 for `clearance` b and `enclosed_height` h in metres (D. 7)."""
    b = np.minimum(clearance, config.clearance_cap) / config.clearance_cap
    h = np.minimum(enclosed_height, config.enclosed_height_cap) / config.enclosed_height_cap
    # Eq. 8
    return np.asarray(np.tanh(config.weight_clearance * b) * np.tanh(config.weight_height * h))


def critic_score(features: GraspFeatures, critic: Critic, config: RankingConfig) -> Array:
    """Return the expected quality (k,), less where the weight turns what is held (D. 143)."""
    known = features.known
    arm = torque_arm(features.found.grasps, known.centre, known.up)
    return np.asarray(critic(features) / (1.0 + (arm / config.half_torque_arm) ** 2))


def torque_arm(grasps: GraspPoses, centre: Array, up: Array) -> Array:
    """Return (n,) metres, the arm at which a weight at `centre` (3,) turns about the closing line.

    What hangs straight below the line, or lies on it, has none.
    """
    moment = np.cross(centre - grasps.translation, up)
    return np.asarray(np.abs((moment * grasps.closing).sum(axis=1)))


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
