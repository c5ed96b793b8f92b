"""What feasible grasps are ranked by: Eq. 8, or the quality that a critic expects (D. 82)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.configs import SelectionConfig
from pipelines.grasping.grasp_candidates import RankedGrasps
from pipelines.grasping.ranking.grasp_features import GraspFeatures
from pipelines.grasping.ranking.known_region import KnownRegion
from pipelines.grasping.ranking.point_critic import PointCritic

Array = NDArray[np.float64]
# Of feasible grasps, their stability and the seen share of their tips' room.
Score = Callable[[RankedGrasps, Array, Array], Array]


class Critic(Protocol):
    """What expects something of hands."""

    def expect(self, views: GraspFeatures) -> Array:
        """Return (k,) the quality to expect of each hand, 0 to 1."""


@dataclass(frozen=True)
class GraspCritic:
    """The network that `symgrasp train-critic grasps` trains on verdicts among true meshes."""

    network: PointCritic

    def expect(self, views: GraspFeatures) -> Array:
        """Return (k,) the quality to expect of each hand, 0 to 1."""
        candidates = views.candidates()
        return self.network.probability(views.points(), candidates[:, :0], candidates)


@dataclass(frozen=True)
class Ranking:
    """What ranks grasps, and which of them are worth it.

    Attributes:
        score: the higher, the better.
        min_stability: of the steadiest candidate's, that a candidate needs.
        count: candidates at most, the steadiest.
    """

    score: Score
    min_stability: float
    count: int


def by_eq8(config: SelectionConfig) -> Ranking:
    """Return the paper's ranking.

    Eq. 8 knows what was seen. Room that was not may hold the object's own far side, so its score
    counts by the share of the finger tips' room that was seen to be free (D. 68).
    """

    def score(found: RankedGrasps, stability: Array, visible: Array) -> Array:
        del stability
        s = rank_score(found.clearance, found.enclosed_height, config)
        return np.asarray(s * (1.0 - config.weight_unseen * (1.0 - visible)))

    return Ranking(score, config.min_stability, config.max_ranked)


def rank_score(clearance: ArrayLike, enclosed_height: ArrayLike, config: SelectionConfig) -> Array:
    """Return s of Eq. 8 for `clearance` b and `enclosed_height` h in metres (D. 7)."""
    b = np.minimum(clearance, config.clearance_cap) / config.clearance_cap
    h = np.minimum(enclosed_height, config.enclosed_height_cap) / config.enclosed_height_cap
    # Eq. 8
    return np.asarray(np.tanh(config.weight_clearance * b) * np.tanh(config.weight_height * h))


def by_critic(critic: Critic, known: KnownRegion, config: SelectionConfig) -> Ranking:
    """Return the ranking by the quality to expect of each hand at a region."""

    def score(found: RankedGrasps, stability: Array, visible: Array) -> Array:
        return critic.expect(GraspFeatures(found, stability, visible, known))

    return Ranking(score, config.critic_min_stability, config.max_ranked)
