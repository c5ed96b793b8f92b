"""From one region to ranked grasps: by symmetry, from the boundary, or at random."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.geometry.transforms import unit
from pipelines.grasping.candidates.completion import Completion, completions
from pipelines.grasping.candidates.decoding import ContactPairs, contact_pairs
from pipelines.grasping.candidates.planar import planar_candidates
from pipelines.grasping.grasp_candidates import Candidates, RankedGrasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud, Surroundings
from pipelines.grasping.ranking.known_region import KnownRegion
from pipelines.grasping.ranking.ranking import Critic, Ranking, by_critic, by_eq8
from pipelines.grasping.ranking.suppression import non_maximum_suppression
from pipelines.grasping.selection import select, surroundings

Array = NDArray[np.float64]

MIN_POINTS = 20  # fewer show no surface
PLANAR_TURNS = np.radians([0.0, 20.0, -20.0, 40.0, -40.0])  # about the contact line
RANDOM_DRAWS = 4000


def plan_region(
    region: RegionCloud,
    scene: SceneCloud,
    slots: SymmetrySlots,
    affordance: Array,
    gripper: Gripper,
    config: SelectionConfig,
    critic: Critic | None = None,
    completion: Completion | None = None,
) -> RankedGrasps:
    """Return symmetric grasps of `region`, or planar ones where none is feasible (Sec. III-F).

    With a critic, planar ones join where it expects little of the symmetric ones (D. 82), and then
    those across symmetries that are doubted (D. 88). Where what lies unseen behind other regions
    leaves no grasp, it is not minded (D. 85).

    Args:
        region: n points.
        scene: what the gripper must not touch.
        slots: the region's symmetries, camera frame.
        affordance: (n,) of the region's points.
        gripper: the hand.
        config: thresholds.
        critic: of hands; None to rank by Eq. 8.
        completion: what symmetries put where nothing is seen; None for the region's own alone.
    """
    if len(region) < MIN_POINTS:
        return RankedGrasps.empty()
    if completion is None:
        completion = completions([region], scene, [slots], config)[0]
    around = surroundings(region, scene, gripper, config)
    ranking = _ranking(region, scene, slots, completion.own, around, config, critic)
    search = _Search(region, scene, slots, affordance, gripper, config, ranking, critic is not None)
    pairs = search.across(slots, config)
    found = search.best(pairs, around.with_unseen(completion.others), completion.own)
    if len(found) or not len(completion.others):
        return found
    return search.best(pairs, around, completion.own)


@dataclass(frozen=True)
class _Search:
    """The search for the grasps of one region; fields as `plan_region` has them."""

    region: RegionCloud
    scene: SceneCloud
    slots: SymmetrySlots
    affordance: Array
    gripper: Gripper
    config: SelectionConfig
    ranking: Ranking
    has_critic: bool

    def best(self, pairs: Candidates, around: Surroundings, own: Array) -> RankedGrasps:
        """Return grasps of symmetric `pairs`, and of others where these do not serve.

        `around`: what the hand must not touch; `own`: (m, 3) what symmetries put behind the
        region, which planar grasps do not mind.
        """
        whole, turns = around.with_unseen(own), self._turns()
        found = self._feasible(pairs, turns, whole)
        if self._serve(found):
            return found
        flat = planar_candidates(self.region, self.scene, self.gripper, self.config)
        found = joined(found, self._feasible(flat, PLANAR_TURNS, around), self.config)
        if self._serve(found) or not self.has_critic:
            return found
        others = self.across(*_doubted(self.slots, self.config))
        return joined(found, self._feasible(others, turns, whole), self.config)

    def across(self, slots: SymmetrySlots, config: SelectionConfig) -> Candidates:
        """Return contact pairs across those of `slots` that `config` trusts."""
        region, scene = self.region, self.scene
        pairs = contact_pairs(region, scene, slots, self.affordance, self.gripper, config)
        return _symmetric_candidates(pairs, region, scene)

    def _serve(self, found: RankedGrasps) -> bool:
        if not len(found):
            return False
        return not self.has_critic or bool(found.rank_score[0] >= self.config.planar_below)

    def _feasible(self, pairs: Candidates, turns: Array, around: Surroundings) -> RankedGrasps:
        return select(
            pairs,
            turns,
            self.region,
            self.scene,
            self.gripper,
            self.config,
            around,
            self.ranking,
        )

    def _turns(self) -> Array:
        return np.linspace(0.0, 2 * np.pi, self.config.num_approach_angles, endpoint=False)


def _ranking(
    region: RegionCloud,
    scene: SceneCloud,
    slots: SymmetrySlots,
    completed: Array,
    around: Surroundings,
    config: SelectionConfig,
    critic: Critic | None,
) -> Ranking:
    """Return what ranks hands: the critic, who knows this, or Eq. 8."""
    if critic is None:
        return by_eq8(config)
    known = KnownRegion(region, scene, slots, completed, around.others.points)
    return by_critic(critic, known, config)


def _symmetric_candidates(
    pairs: ContactPairs, region: RegionCloud, scene: SceneCloud
) -> Candidates:
    return Candidates(
        pairs.contacts,
        _base_approach(region, scene, len(pairs)),
        pairs.quality,
        pairs.affordance,
        pairs.slot,
        "network",
    )


def _doubted(
    slots: SymmetrySlots, config: SelectionConfig
) -> tuple[SymmetrySlots, SelectionConfig]:
    """Return the symmetries that are trusted too little to be asked first, and what admits them."""
    existence = np.where(slots.existence < config.min_confidence, slots.existence, 0.0)
    return replace(slots, existence=existence), replace(
        config, min_confidence=config.min_doubtful_confidence
    )


def joined(first: RankedGrasps, second: RankedGrasps, config: SelectionConfig) -> RankedGrasps:
    """Return the grasps of both, best first, alike ones left out."""
    if not len(first) or not len(second):
        return first if len(first) else second
    both = RankedGrasps.concatenate([first, second])
    both = both[np.argsort(-both.rank_score, kind="stable")]
    kept = non_maximum_suppression(
        both.grasps, config.nms_distance, config.nms_angle, lambda some: np.ones(len(some), bool)
    )
    return both[kept]


def plan_planar(
    region: RegionCloud,
    scene: SceneCloud,
    gripper: Gripper,
    config: SelectionConfig,
    critic: Critic | None = None,
) -> RankedGrasps:
    """Return feasible grasps from the boundary of `region`, best first (D. 8).

    `critic`: of hands; None to rank by Eq. 8.
    """
    if len(region) < MIN_POINTS:
        return RankedGrasps.empty()
    around = surroundings(region, scene, gripper, config)
    nothing = SymmetrySlots.empty(), np.zeros((0, 3))
    ranking = _ranking(region, scene, *nothing, around, config, critic)
    candidates = planar_candidates(region, scene, gripper, config)
    return select(candidates, PLANAR_TURNS, region, scene, gripper, config, around, ranking)


def plan_random(
    region: RegionCloud,
    scene: SceneCloud,
    gripper: Gripper,
    config: SelectionConfig,
    rng: np.random.Generator,
) -> RankedGrasps:
    """Return feasible grasps on random antipodal pairs of `region`: a baseline.

    Pairs are drawn from the region's points; both normals must be within the contact angle of
    the line between them, as far as such pairs are seen from one side. A region too small for any
    width of the hand has none.
    """
    if len(region) < MIN_POINTS:
        return RankedGrasps.empty()
    contacts = _random_contacts(region, gripper, config, rng)
    count = len(contacts)
    if not count:
        return RankedGrasps.empty()
    candidates = Candidates(
        contacts,
        _base_approach(region, scene, count),
        np.ones(count),
        np.zeros(count),
        np.full(count, -1, np.int64),
        "random",
    )
    turns = np.linspace(0.0, 2 * np.pi, config.num_approach_angles, endpoint=False)
    around = surroundings(region, scene, gripper, config)
    ranking = by_eq8(config)
    return select(candidates, turns, region, scene, gripper, config, around, ranking)


def _random_contacts(
    region: RegionCloud, gripper: Gripper, config: SelectionConfig, rng: np.random.Generator
) -> Array:
    """Return (n, 2, 3) random pairs of the region's points that the hand's width allows.

    Antipodal ones; where none is drawn, all, the least bad first.
    """
    first, second = rng.integers(0, len(region), (2, RANDOM_DRAWS))
    contacts = np.stack([region.points[first], region.points[second]], 1)
    line = unit(contacts[:, 1] - contacts[:, 0])
    cosine = np.minimum(
        -np.einsum("ni,ni->n", line, region.normals[first]),
        np.einsum("ni,ni->n", line, region.normals[second]),
    )
    width = np.linalg.norm(contacts[:, 1] - contacts[:, 0], axis=1)
    fits = (width >= config.min_width) & (width <= gripper.max_width)
    chosen = np.flatnonzero(fits & (cosine > np.cos(config.max_contact_angle)))
    if not len(chosen):  # nothing antipodal is seen
        order = np.argsort(-cosine, kind="stable")
        chosen = order[fits[order]]
    return np.asarray(contacts[chosen[: config.max_pairs]])


def _base_approach(region: RegionCloud, scene: SceneCloud, count: int) -> Array:
    """Return (count, 3) the direction nearest to angle 0: into the table, or the view."""
    base = scene.inward if scene.inward is not None else region.view_ray
    return np.broadcast_to(base, (count, 3)).copy()
