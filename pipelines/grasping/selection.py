"""Physics-feasible selection and ranking of grasp candidates (Sec. III-F)."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import unit
from pipelines.grasping.feasibility.approach_path import approach_is_free, keeps_off_table
from pipelines.grasping.feasibility.collision import clearance, first_free, turned
from pipelines.grasping.feasibility.opening_margin import with_opening_margin
from pipelines.grasping.feasibility.visibility import visible_fraction
from pipelines.grasping.grasp_candidates import Candidates, RankedGrasps
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud, Surroundings
from pipelines.grasping.ranking.ranking import Ranking
from pipelines.grasping.ranking.suppression import non_maximum_suppression

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MAX_ROUNDS = 4  # of `max_pairs` pairs each, before a region counts as out of reach
ROUNDING = 1e-6  # metres
MOST = 0.9  # of the region lies within the radius that a grasp is off its middle by
OFF_CENTRE = 0.5  # stability lost by a grasp at the region's rim


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
    base = Grasps.from_contacts(candidates.contacts, candidates.approach)
    prior = candidates.quality * _centredness(base, region)
    order = np.argsort(-prior, kind="stable")
    hands, row = _reachable(base[order], np.asarray(angles, np.float64), scene, gripper, config)
    if around.border is not None:
        in_view = around.border.is_kept(hands, gripper)
        hands, row = hands[in_view], row[in_view]
    pair = order[row]
    number = np.cumsum(np.diff(pair, prepend=-1) != 0) - 1  # of each hand's pair, among these
    for start in range(0, MAX_ROUNDS * config.max_pairs, config.max_pairs):
        tried = slice(*np.searchsorted(number, (start, start + config.max_pairs)))
        if tried.start == tried.stop:
            break
        stability = prior[pair[tried]]
        share, most = ranking.min_stability, ranking.count
        free, enclosed = first_free(
            hands[tried], gripper, around.met, config, stability, share, most
        )
        if len(free):
            grasps, stability = hands[tried][free], stability[free]
            b = clearance(grasps, gripper, around.others, config.clearance_cap)
            h = np.minimum(enclosed, config.enclosed_height_cap)
            found = _found(candidates, pair[tried][free], grasps, b, h)
            visible = visible_fraction(grasps, gripper, scene)
            ranked = _in_order(found, ranking.score(found, stability, visible), stability)
            can_approach = partial(
                approach_is_free,
                gripper=gripper,
                near=around.met,
                scene=scene.coarse,
                config=config,
            )
            kept = non_maximum_suppression(
                ranked.grasps, config.nms_distance, config.nms_angle, can_approach
            )
            if len(kept):
                return with_opening_margin(ranked[kept], scene, gripper, config, around)
    return RankedGrasps.empty()


def surroundings(
    region: RegionCloud, scene: SceneCloud, gripper: Gripper, config: SelectionConfig
) -> Surroundings:
    """Return the observed points that a hand at `region`, off the table, may meet or come near."""
    reach = gripper.finger_length + gripper.palm_depth + config.clearance_cap
    floor = None
    if scene.plane is not None:
        # Hands stay `min_table_distance` above the table. Blown up by a margin, their corners
        # reach down by that times the root of three at most.
        lowest = config.min_table_distance - np.sqrt(3.0) * config.body_margin - ROUNDING
        floor = Plane(scene.plane.normal, float(scene.plane.offset - lowest))
    return scene.around(region, reach, config.scene_resolution, floor)


def _reachable(
    base: Grasps, turns: Array, scene: SceneCloud, gripper: Gripper, config: SelectionConfig
) -> tuple[Grasps, Indices]:
    """Return `base` (k,) turned by those of `turns` (m,) that may be tried, and of which k each is.

    They open enough, keep off the table and come from the camera's side.
    """
    cosine, sine = np.cos(turns), np.sin(turns)
    third = base.rotation[:, :, 2]

    def along(direction: Array) -> Array:
        """(k, m) cosines between approaches and `direction`, (k, 3) or (3,)."""
        ahead, aside = (base.approach * direction).sum(axis=1), (third * direction).sum(axis=1)
        return np.outer(ahead, cosine) + np.outer(aside, sine)

    plane = scene.plane
    farthest = config.max_view_angle if plane is None else config.max_hidden_angle
    fits = along(unit(base.translation)) > np.cos(farthest)
    fits &= ((base.width >= config.min_width) & (base.width <= gripper.max_width))[:, None]
    if plane is not None:
        fits &= along(-plane.normal) > np.cos(config.max_approach_angle)
    row, turn = np.nonzero(fits)
    hands = turned(base, row, turns[turn])
    if scene.limits is not None:
        allowed = scene.limits.allow(hands)
        hands, row = hands[allowed], row[allowed]
    if plane is not None:
        high = keeps_off_table(hands, plane, gripper, config)
        hands, row = hands[high], row[high]
    return hands, row


def _centredness(grasps: Grasps, region: RegionCloud) -> Array:
    """Return (n,) 1 for grasps about the region's middle, less toward its rim."""
    centre = region.middle
    radius = quantiles(np.linalg.norm(region.points - centre, axis=1), MOST)
    off = np.linalg.norm(grasps.translation - centre, axis=1) / max(float(radius), 1e-3)
    return np.asarray(1.0 - OFF_CENTRE * np.minimum(off, 1.0))


def _found(
    candidates: Candidates, pair: Indices, grasps: Grasps, clearances: Array, height: Array
) -> RankedGrasps:
    """Return the hands `grasps` (n,) at `pair` (n,) of `candidates`, not yet ranked."""
    source = np.full(len(pair), candidates.source)
    affordance, slot = candidates.affordance[pair], candidates.slot[pair]
    return RankedGrasps(grasps, affordance, slot, source, clearances, height, np.zeros(len(pair)))


def _in_order(found: RankedGrasps, score: Array, stability: Array) -> RankedGrasps:
    """Return `found` by `score` (n,), best first; the steadier first where these agree."""
    ranked = replace(found, rank_score=score)
    return ranked[np.lexsort((-stability, -np.round(score, 6)))]
