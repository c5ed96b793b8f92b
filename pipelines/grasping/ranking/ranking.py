"""Ranking of feasible grasps by Eq. 8, or by a critic's expected quality (D. 82).

Non-maximum suppression keeps only the best of alike grasps (D. 78).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import RankingConfig
from pipelines.grasping.critics.point_critic import PointCritic
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.grasp_features import GraspFeatures

HALF_TURN = np.array([1.0, -1.0, -1.0])  # about the approach: the fingers are swapped
ROUNDING = 1e-6  # radians; two approach angles exactly at the limit are not alike

Critic = Callable[[GraspFeatures], Array]  # expected quality (k,) of k grasps, 0 to 1


def expected_quality(network: PointCritic, features: GraspFeatures) -> Array:
    """Return the expected quality (k,) by the network of `train-critic grasps`; a `Critic`."""
    candidates = features.candidates()
    return network.probability(features.points(), candidates[:, :0], candidates)


def visible_eq8_score(found: RankedGrasps, visible: Array, config: RankingConfig) -> Array:
    """Return s of Eq. 8 (n,), reduced where the space around the finger tips is unseen (D. 68).

    Eq. 8 uses seen points only, but the object's unseen side may be in unseen space. `visible`:
    (n,) visible fraction.
    """
    s = eq8_score(found.clearance, found.enclosed_height, config)
    return np.asarray(s * (1.0 - config.weight_unseen * (1.0 - visible)))


def eq8_score(clearance: ArrayLike, enclosed_height: ArrayLike, config: RankingConfig) -> Array:
    """Return s (n,) of Eq. 8 for `clearance` b and `enclosed_height` h, (n,) metres (D. 7)."""
    b = np.minimum(clearance, config.clearance_cap) / config.clearance_cap
    h = np.minimum(enclosed_height, config.enclosed_height_cap) / config.enclosed_height_cap
    # Eq. 8
    return np.asarray(np.tanh(config.weight_clearance * b) * np.tanh(config.weight_height * h))


def critic_score(features: GraspFeatures, critic: Critic, config: RankingConfig) -> Array:
    """Return the expected quality (k,), reduced by the torque of the weight (D. 143)."""
    context = features.context
    arm = torque_arm(features.feasible.grasps, context.center, context.scene.up)
    return np.asarray(critic(features) / (1.0 + (arm / config.half_torque_arm) ** 2))


def torque_arm(grasps: GraspPoses, center: Array, up: Array) -> Array:
    """Return the lever arm (n,), metres, of a weight at `center` (3,) about the closing line.

    The arm is 0 for a centre on the line or straight below. `up`: (3,) unit, camera frame.
    """
    moment = np.cross(center - grasps.translation, up)
    return np.asarray(np.abs((moment * grasps.closing).sum(axis=1)))


def non_maximum_suppression(
    grasps: GraspPoses,
    distance: float,
    angle: float,
    sound: Callable[[GraspPoses], Mask | bool] = lambda _some: True,
) -> Indices:
    """Return the indices (m,) of sound `grasps`, best first, that differ from all better grasps.

    A grasp is removed if the origin of a better grasp that stays is nearer than `distance` metres,
    and their rotations, with fingers swapped or not, differ by less than `angle` radians. `sound`
    is called for few grasps: the others are suppressed in any case.
    """
    near = are_near(grasps, distance, angle)
    left, checked = np.ones(len(grasps), np.bool_), np.zeros(len(grasps), np.bool_)
    while True:
        first = _greedy(near, left)
        unknown = first[~checked[first]]
        if not len(unknown):
            return first
        # Grasps suppressed by an unsound grasp may stay, and are checked in the next round.
        left[unknown] = sound(grasps[unknown])
        checked[unknown] = True


def are_near(grasps: GraspPoses, distance: float, angle: float) -> Mask:
    """Return a mask (n, n) of pairs nearer than `distance` (metres) and `angle` (radians)."""
    R = grasps.rotation.reshape(-1, 9)
    swapped = (grasps.rotation * HALF_TURN).reshape(-1, 9)
    trace = np.maximum(R @ R.T, R @ swapped.T)  # 1 + 2 cos(angle)
    x, y, z = (np.subtract.outer(places, places) for places in grasps.translation.T)
    alike = trace > 1.0 + 2.0 * np.cos(angle - ROUNDING)
    return np.asarray(alike & (x * x + y * y + z * z < distance**2))


def _greedy(near: Mask, left: Mask) -> Indices:
    """Return the indices of `left` (n,) that are not `near` (n, n) an earlier returned index."""
    free, kept = left.copy(), []
    for index in range(len(free)):
        if free[index]:
            kept.append(index)
            free &= ~near[index]
    return np.array(kept, np.int64)
