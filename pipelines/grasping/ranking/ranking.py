"""The ranking of feasible grasps: by Eq. 8, or by the quality that a critic expects (D. 82)."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array
from pipelines.configs import RankingConfig
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.grasp_features import GraspFeatures
from pipelines.grasping.ranking.known_region import KnownRegion
from pipelines.grasping.ranking.point_critic import PointCritic


class Critic(Protocol):
    """A network that expects a quality of each grasp."""

    def expect(self, features: GraspFeatures, /) -> Array:
        """Return (k,) the expected quality of each grasp, 0 to 1."""


@dataclass(frozen=True)
class GraspCritic:
    """The network that `symgrasp train-critic grasps` trains on verdicts among true meshes."""

    network: PointCritic

    def expect(self, features: GraspFeatures, /) -> Array:
        """Return (k,) the expected quality of each grasp, 0 to 1."""
        candidates = features.candidates()
        return self.network.probability(features.points(), candidates[:, :0], candidates)


@dataclass(frozen=True)
class ByEq8:
    """The paper's ranking.

    Eq. 8 knows the seen points alone. The object's own far side may lie in space that is not seen,
    so the score counts by the share of the finger tips' space that is seen to be free (D. 68).
    """

    config: RankingConfig

    @property
    def min_stability(self) -> float:
        """Stability that a grasp needs to be scored, relative to the most stable one."""
        return self.config.min_stability

    def score(self, found: RankedGrasps, stability: Array, visible: Array) -> Array:
        """Return s of Eq. 8 (n,), less where the camera does not see.

        Args:
            found: n feasible grasps, their rank_score not known yet.
            stability: (n,) the prior that they were tried by.
            visible: (n,) share of the finger tips' space that is seen to be free.
        """
        del stability
        s = eq8_score(found.clearance, found.enclosed_height, self.config)
        return np.asarray(s * (1.0 - self.config.weight_unseen * (1.0 - visible)))


def eq8_score(clearance: ArrayLike, enclosed_height: ArrayLike, config: RankingConfig) -> Array:
    """Return s of Eq. 8 for `clearance` b and `enclosed_height` h in metres (D. 7)."""
    b = np.minimum(clearance, config.clearance_cap) / config.clearance_cap
    h = np.minimum(enclosed_height, config.enclosed_height_cap) / config.enclosed_height_cap
    # Eq. 8
    return np.asarray(np.tanh(config.weight_clearance * b) * np.tanh(config.weight_height * h))


@dataclass(frozen=True)
class ByCritic:
    """The ranking by the quality that `critic` expects of each grasp at the region `known`."""

    config: RankingConfig
    critic: Critic
    known: KnownRegion

    @property
    def min_stability(self) -> float:
        """Stability that a grasp needs, relative to the most stable one."""
        return self.config.critic_min_stability

    def score(self, found: RankedGrasps, stability: Array, visible: Array) -> Array:
        """Return the expected quality (n,), less where the weight turns what is held (D. 143).

        Arguments are those of `ByEq8.score`.
        """
        expected = self.critic.expect(GraspFeatures(found, stability, visible, self.known))
        arm = torque_arm(found.grasps, self.known.centre, self.known.up)
        return np.asarray(expected / (1.0 + (arm / self.config.half_torque_arm) ** 2))


Ranking = ByEq8 | ByCritic


def torque_arm(grasps: GraspPoses, centre: Array, up: Array) -> Array:
    """Return (n,) metres, the arm at which a weight at `centre` (3,) turns about the closing line.

    What hangs straight below the line, or lies on it, has none.
    """
    moment = np.cross(centre - grasps.translation, up)
    return np.asarray(np.abs((moment * grasps.closing).sum(axis=1)))
