"""Physics-feasible selection and ranking of grasp candidates (Sec. III-F)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.quantiles import quantiles
from pipelines.geometry.transforms import unit
from pipelines.grasping.candidates import Candidates, RankedGrasps
from pipelines.grasping.collision import Obstacles, clearance, lowest_height, meets, turned
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud, Surroundings
from pipelines.grasping.ranking import Ranking
from pipelines.grasping.suppression import different
from pipelines.grasping.visibility import seen_share
from pipelines.grasping.way_in import way_is_free

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_ROUNDS = 4  # of `max_pairs` pairs each, before a region counts as out of reach
BATCH = 16  # pairs that are tried at a time
ROUNDING = 1e-6  # metres
MOST = 0.9  # of the region lies within the radius that a grasp is off its middle by
OFF_CENTRE = 0.5  # steadiness lost by a grasp at the region's rim


def select(
    candidates: Candidates,
    angles: Sequence[float] | Array,
    region: RegionCloud,
    scene: SceneCloud,
    gripper: Gripper,
    config: SelectionConfig,
    around: Surroundings,
    ranking: Ranking,
) -> RankedGrasps:
    """Return the candidates that are feasible at one of `angles` (radians), best first.

    Pairs are tried in rounds, the steadiest first, until a round has feasible ones, and in a round
    as long as they are worth ranking. `around` is what the hand must not meet (`surroundings`).
    """
    turns = np.asarray(angles, np.float64)
    base = Grasps.from_contacts(candidates.contacts, candidates.approach)
    steady = candidates.quality * _centredness(base, region)
    count = len(turns)
    hands = turned(base, np.repeat(np.arange(len(base)), count), np.tile(turns, len(base)))
    allowed = _reachable(hands, scene, gripper, config).reshape(len(base), count)
    order = np.argsort(-steady, kind="stable")
    order = order[allowed[order].any(axis=1)]
    obstacles = _above_table(around, scene, config)
    trial = _Trial(hands, allowed, steady, obstacles, gripper, config, ranking)
    for start in range(0, min(len(order), MAX_ROUNDS * config.max_pairs), config.max_pairs):
        hand, enclosed = trial.feasible(order[start : start + config.max_pairs])
        if len(hand):
            kept = _steadiest(steady[hand // count], ranking)
            hand, pair = hand[kept], hand[kept] // count
            found = _ranked(candidates, pair, hands[hand], enclosed[kept])
            b = clearance(found.grasps, gripper, around.others, config.clearance_cap)
            sight = seen_share(found.grasps, gripper, scene)
            ranked = _in_order(found, b, steady[pair], sight, ranking, config)
            free = partial(
                way_is_free, gripper=gripper, near=obstacles, scene=scene.coarse, config=config
            )
            kept = different(ranked.grasps, config.nms_distance, config.nms_angle, free)
            if len(kept):
                return ranked[kept]
    return RankedGrasps.empty()


def surroundings(
    region: RegionCloud, scene: SceneCloud, gripper: Gripper, config: SelectionConfig
) -> Surroundings:
    """Return the observed points that a hand at `region` may meet or come near to."""
    reach = gripper.finger_length + gripper.palm_depth + config.clearance_cap
    return scene.around(region, reach, config.scene_resolution)


def _above_table(around: Surroundings, scene: SceneCloud, config: SelectionConfig) -> Obstacles:
    """Return what a hand can meet that stays `min_table_distance` above the table, if there is one.

    Blown up by a margin, its corners reach down by that times the root of three at most.
    """
    if scene.plane is None:
        return Obstacles(around.points, around.count)
    lowest = config.min_table_distance - np.sqrt(3.0) * config.body_margin - ROUNDING
    above = scene.plane.height(around.points) > lowest
    return Obstacles(around.points[above], around.count[above])


@dataclass(frozen=True)
class _Trial:
    """Hands of k pairs at m angles (k * m), which are allowed (k, m), and what is in the way."""

    hands: Grasps
    allowed: Mask
    steady: Array
    obstacles: Obstacles
    gripper: Gripper
    config: SelectionConfig
    ranking: Ranking

    def feasible(self, pairs: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
        """Return the hands of `pairs`, steadiest first, that are free, and what they enclose.

        Pairs that `_steadiest` would leave out whatever they meet are not tried.
        """
        count = self.allowed.shape[1]
        hands, heights, best = [np.zeros(0, np.int64)], [np.zeros(0)], -np.inf
        for start in range(0, len(pairs), BATCH):
            batch = pairs[start : start + BATCH]
            enough = sum(map(len, hands)) >= self.ranking.count
            if enough or self.steady[batch[0]] < self.ranking.steadiness * best:
                break
            row, turn = np.nonzero(self.allowed[batch])
            hand = batch[row] * count + turn
            margin, few = self.config.body_margin, self.config.max_points_inside
            met, enclosed = meets(self.hands[hand], self.gripper, self.obstacles, margin, few)
            free = ~met & (enclosed >= self.config.min_enclosed)
            hands.append(hand[free])
            heights.append(enclosed[free])
            if free.any():
                best = max(best, float(self.steady[hand[free][0] // count]))
        return np.concatenate(hands), np.concatenate(heights)


def _ranked(
    candidates: Candidates, pair: NDArray[np.int64], grasps: Grasps, enclosed: Array
) -> RankedGrasps:
    zero = np.zeros(len(pair))
    source = np.full(len(pair), candidates.source)
    affordance, slot = candidates.affordance[pair], candidates.slot[pair]
    return RankedGrasps(grasps, affordance, slot, source, zero, enclosed, zero)


def _in_order(
    found: RankedGrasps,
    clearances: Array,
    steady: Array,
    sight: Array,
    ranking: Ranking,
    config: SelectionConfig,
) -> RankedGrasps:
    """Return `found` with its numbers, best first; the steadier first where these agree."""
    h = np.minimum(found.enclosed_height, config.enclosed_height_cap)
    known = replace(found, clearance=clearances, enclosed_height=h)
    ranked = replace(known, rank_score=ranking.score(known, steady, sight))
    return ranked[np.lexsort((-steady, -np.round(ranked.rank_score, 6)))]


def _reachable(hands: Grasps, scene: SceneCloud, gripper: Gripper, config: SelectionConfig) -> Mask:
    """Return (n,) which hands open enough, keep off the table and come from the camera's side."""
    fits = (hands.width >= config.min_width) & (hands.width <= gripper.max_width)
    if scene.limits is not None:
        fits &= scene.limits.allow(hands)
    along_view = np.einsum("ni,ni->n", hands.approach, unit(hands.translation))
    if scene.plane is None:
        return np.asarray(fits & (along_view > np.cos(config.max_view_angle)))
    fits &= along_view > np.cos(config.max_hidden_angle)
    fits &= -hands.approach @ scene.plane.normal > np.cos(config.max_approach_angle)
    swept = gripper.swept(config.approach_distance)
    fits[fits] = lowest_height(hands[fits], swept, scene.plane) >= config.min_table_distance
    return np.asarray(fits)


def _centredness(grasps: Grasps, region: RegionCloud) -> Array:
    """Return (n,) 1 for grasps about the region's middle, less toward its rim."""
    centre = region.middle
    radius = quantiles(np.linalg.norm(region.points - centre, axis=1), MOST)
    off = np.linalg.norm(grasps.translation - centre, axis=1) / max(float(radius), 1e-3)
    return np.asarray(1.0 - OFF_CENTRE * np.minimum(off, 1.0))


def _steadiest(steady: Array, ranking: Ranking) -> NDArray[np.int64]:
    """Return the indices of the candidates that are worth ranking, steadiest first."""
    order = np.argsort(-steady, kind="stable")[: ranking.count]
    worth = steady[order] >= ranking.steadiness * steady.max(initial=0.0)
    return np.asarray(order[worth], np.int64)
