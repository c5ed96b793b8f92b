"""The grasps of one region: physics-feasible selection and ranking (Sec. III-F).

A list of passes proposes contact pairs: across the region's symmetries, from its outline, across
doubtful symmetries; `passes.py` lists the obstacles of each pass. The feasible grasps of a pass are
ranked, by the grasp critic or by Eq. 8, with non-maximum suppression. A pass is skipped if the
grasps of earlier passes are expected to be good enough.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import SelectionConfig
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.grasping.candidates.candidates import GraspCandidates
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.feasibility.openings import with_fitted_openings
from pipelines.grasping.feasibility.visibility import visible_fraction
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.passes import (
    Attempt,
    Pass,
    RegionModel,
    attempts,
    planar_pass,
    symmetric_pass,
)
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.grasp_features import GraspFeatures
from pipelines.grasping.ranking.ranking import (
    Critic,
    critic_score,
    non_maximum_suppression,
    visible_eq8_score,
)
from pipelines.grasping.ranking.region_context import RegionContext
from pipelines.grasping.scene import RegionCloud, SceneCloud

MIN_POINTS = 20  # fewer points show no surface
MOST_INSIDE = 0.9  # share of a region's points within its radius
MIN_RADIUS = 0.001  # metres, of a region, however small
OFF_CENTER = 0.5  # share of the stability that a grasp at this radius or beyond loses


@dataclass(frozen=True)
class RegionPlanner:
    """Selection of grasps, region by region; without a critic, Eq. 8 ranks the grasps."""

    gripper: Gripper
    config: SelectionConfig
    critic: Critic | None = None

    @property
    def ranker(self) -> str:
        """The origin of `rank_score`: `critic` or `eq8`."""
        return "eq8" if self.critic is None else "critic"

    def passes(self) -> tuple[Pass, ...]:
        """Return the passes over a region with known symmetries.

        The critic's scores are expectations: if symmetric grasps have low scores, or are few,
        planar grasps are added (D. 82, D. 146), then grasps across doubtful symmetries (D. 88).
        With Eq. 8, planar grasps are used only if no other grasp is feasible.
        """
        symmetry, sufficient = self.config.symmetry, self.config.ranking.sufficient
        passes = symmetric_pass(symmetry.least_confidence), planar_pass(sufficient)
        if self.critic is None or not symmetry.is_fitted:
            return passes
        return *passes, symmetric_pass(0.0, symmetry.min_confidence, sufficient)

    def plan(
        self, region: RegionModel, scene: SceneCloud, passes: Sequence[Pass] | None = None
    ) -> RankedGrasps:
        """Return feasible grasps of `region`, best first.

        `passes`: kinds of candidates; None for `passes()`.
        """
        found = [grasps for _, grasps in self.attempted(region, scene, passes)]
        return found[-1] if found else RankedGrasps.empty()

    def attempted(
        self, region: RegionModel, scene: SceneCloud, passes: Sequence[Pass] | None = None
    ) -> Iterator[tuple[Attempt, RankedGrasps]]:
        """Yield each attempt at `region` with its grasps, up to the first attempt with grasps."""
        if len(region.cloud) < MIN_POINTS:
            return
        passes = self.passes() if passes is None else passes
        config, cap = self.config.feasibility, self.config.ranking.clearance_cap
        feasibility = Feasibility.at(region.cloud, scene, self.gripper, config, cap)
        context = RegionContext(
            region.cloud,
            feasibility.scene,
            region.symmetries,
            hidden=region.completion.own,
            foreign=feasibility.around.others.points,
        )
        for attempt in attempts(feasibility, region.completion):
            found = self._by_passes(passes, region, attempt, context)
            yield attempt, found
            if len(found):
                return

    def _by_passes(
        self,
        passes: Sequence[Pass],
        region: RegionModel,
        attempt: Attempt,
        context: RegionContext,
    ) -> RankedGrasps:
        """Return the grasps of all passes at one attempt, best first.

        If the grasps of earlier passes suffice, a pass adds alternatives, which rank after the best
        grasp, or is skipped if there are enough (D. 146).
        """
        found = RankedGrasps.empty()
        enough = 0 if self.critic is None else self.config.ranking.alternatives
        for step in passes:
            suffices = self._expected(found) >= step.unless_expected
            if suffices and len(found) >= enough:
                continue
            checks = attempt.checks_of(step)
            candidates = step.candidates(region, checks, self.config.candidates)
            more = self._select(candidates, checks, context)
            if suffices:
                best = found.rank_score[0]
                more = replace(more, rank_score=np.minimum(more.rank_score, best))
            found = self._merged(found, more)
        return found

    def _expected(self, found: RankedGrasps) -> float:
        """Return the best expected quality; with Eq. 8, which expects none, any grasp suffices."""
        if not len(found):
            return -np.inf
        return 1.0 if self.critic is None else float(found.rank_score[0])

    def _select(
        self, candidates: GraspCandidates, feasibility: Feasibility, context: RegionContext
    ) -> RankedGrasps:
        """Return the candidates that are feasible at an approach angle, best first.

        The most stable pairs are tried first; `max_ranked` feasible grasps are ranked.
        """
        base = GraspPoses.from_contacts(candidates.contacts, candidates.approach)
        stability = candidates.stability * _centeredness(base, context.region)
        order = np.argsort(-stability, kind="stable")
        grasps, row = feasibility.reachable(base[order], candidates.angles)
        pair = order[row]
        config = self.config.ranking
        least = config.min_stability if self.critic is None else config.critic_min_stability
        free, enclosed = feasibility.first_free(grasps, stability[pair], least, config.max_ranked)
        grasps, pair = grasps[free], pair[free]
        found = RankedGrasps(  # with b and h of Eq. 8, not yet ranked
            grasps,
            candidates.affordance[pair],
            candidates.slot[pair],
            np.full(len(pair), candidates.source),
            clearance=feasibility.clearance(grasps, config.clearance_cap),
            enclosed_height=np.minimum(enclosed, config.enclosed_height_cap),
            rank_score=np.zeros(len(pair)),
        )
        best = self._best_first(found, stability[pair], feasibility, context)
        return with_fitted_openings(best, feasibility, config.clearance_cap)

    def _best_first(
        self,
        found: RankedGrasps,
        stability: Array,
        feasibility: Feasibility,
        context: RegionContext,
    ) -> RankedGrasps:
        """Return `found` by rank, without alike grasps and grasps without a free approach path."""
        if not len(found):
            return found
        visible = visible_fraction(found.grasps, self.gripper, feasibility.scene)
        if self.critic is None:
            score = visible_eq8_score(found, visible, self.config.ranking)
        else:
            features = GraspFeatures(found, stability, visible, context)
            score = critic_score(features, self.critic, self.config.ranking)
        # At equal scores, the more stable grasp comes first.
        order = np.lexsort((-stability, -np.round(score, 6)))
        ranked = replace(found, rank_score=score)[order]
        near = self.config.ranking.nms_distance, self.config.ranking.nms_angle
        return ranked[non_maximum_suppression(ranked.grasps, *near, feasibility.has_free_path)]

    def _merged(self, first: RankedGrasps, second: RankedGrasps) -> RankedGrasps:
        """Return the grasps of both, best first, without alike grasps."""
        if not len(first) or not len(second):
            return first if len(first) else second
        both = RankedGrasps.concatenate([first, second])
        both = both[np.argsort(-both.rank_score, kind="stable")]
        near = self.config.ranking.nms_distance, self.config.ranking.nms_angle
        return both[non_maximum_suppression(both.grasps, *near)]


def _centeredness(grasps: GraspPoses, region: RegionCloud) -> Array:
    """Return the nearness (n,) of grasps to the region's middle: 1 there, less toward the rim."""
    center = region.middle
    radius = quantiles(np.linalg.norm(region.points - center, axis=1), MOST_INSIDE)
    off = np.linalg.norm(grasps.translation - center, axis=1) / max(float(radius), MIN_RADIUS)
    return np.asarray(1.0 - OFF_CENTER * np.minimum(off, 1.0))
