"""Physics-feasible selection and ranking of grasp candidates (Sec. III-F)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.transforms import unit
from pipelines.grasping.collision import clearance, lowest_height, sweep, turned
from pipelines.grasping.grasps import Grasps, Index
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import RegionCloud, SceneCloud

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_RANKED = 96  # steadiest feasible candidates that the clearance is computed for
MAX_ROUNDS = 4  # of `max_pairs` pairs each, before a region counts as out of reach
HIDDEN_COUNT = 1  # measured points that a point known by symmetry alone is worth
OFF_CENTRE = 0.5  # steadiness lost by a grasp at the region's rim


@dataclass(frozen=True)
class Candidates:
    """Contact pairs with a base approach, not yet checked against the scene.

    Attributes:
        contacts: (k, 2, 3) metres, camera frame.
        approach: (k, 3) unit; the angles of the selection turn it about the contact line.
        quality: (k,) 0 to 1, how well the fingers would hold here.
        affordance: (k,) predicted; 0 where nothing was predicted.
        slot: (k,) symmetry slot, -1 without symmetry.
        source: `network`, `planar` or `random`.
    """

    contacts: Array
    approach: Array
    quality: Array
    affordance: Array
    slot: NDArray[np.int64]
    source: str


def no_candidates(source: str) -> Candidates:
    """Return an empty set of candidates."""
    zero = np.zeros(0)
    return Candidates(
        np.zeros((0, 2, 3)), np.zeros((0, 3)), zero, zero, np.zeros(0, np.int64), source
    )


@dataclass(frozen=True)
class RankedGrasps:
    """Feasible grasps of one region, best first. Camera frame, metres.

    Attributes:
        grasps: n grasps.
        affordance: (n,) of the first contact.
        slot: (n,) symmetry slot, -1 without symmetry.
        source: (n,) `network`, `planar` or `random`.
        clearance: (n,) b of Eq. 8 in metres, capped.
        enclosed_height: (n,) h of Eq. 8 in metres, capped.
        rank_score: (n,) s of Eq. 8.
    """

    grasps: Grasps
    affordance: Array
    slot: NDArray[np.int64]
    source: NDArray[np.str_]
    clearance: Array
    enclosed_height: Array
    rank_score: Array

    @classmethod
    def empty(cls) -> "RankedGrasps":
        """Return no grasps."""
        zero = np.zeros(0)
        return cls(Grasps.empty(), zero, np.zeros(0, np.int64), np.zeros(0, "U7"), zero, zero, zero)

    def __len__(self) -> int:
        return len(self.grasps)

    def __getitem__(self, index: Index) -> "RankedGrasps":
        return RankedGrasps(
            self.grasps[index],
            self.affordance[index],
            self.slot[index],
            self.source[index],
            self.clearance[index],
            self.enclosed_height[index],
            self.rank_score[index],
        )


def rank_score(clearance: ArrayLike, enclosed_height: ArrayLike, config: SelectionConfig) -> Array:
    """Return s of Eq. 8 for `clearance` b and `enclosed_height` h in metres (D. 7)."""
    b = np.minimum(clearance, config.clearance_cap) / config.clearance_cap
    h = np.minimum(enclosed_height, config.enclosed_height_cap) / config.enclosed_height_cap
    # Eq. 8
    return np.asarray(np.tanh(config.weight_clearance * b) * np.tanh(config.weight_height * h))


def select(
    candidates: Candidates,
    angles: Sequence[float] | Array,
    region: RegionCloud,
    scene: SceneCloud,
    gripper: Gripper,
    config: SelectionConfig,
    hidden: Array | None = None,
) -> RankedGrasps:
    """Return the candidates that are feasible at one of `angles` (radians), best first.

    Pairs are tried in rounds, the steadiest first, until a round has feasible ones. `hidden`
    (m, 3) are points of the region that the camera does not see and the hand must not meet.
    """
    turns = np.asarray(angles, np.float64)
    base = Grasps.from_contacts(candidates.contacts, candidates.approach)
    reach = gripper.finger_length + gripper.palm_depth + config.clearance_cap
    around = scene.around(region, reach, config.scene_resolution)
    if hidden is not None:
        around = around.with_own(hidden, HIDDEN_COUNT)
    steady = candidates.quality * _centredness(base, region)
    allowed = _reachable(base, turns, scene, gripper, config)
    order = np.argsort(-steady, kind="stable")
    order = order[allowed[order].any(axis=1)]
    for start in range(0, min(len(order), MAX_ROUNDS * config.max_pairs), config.max_pairs):
        tried = order[start : start + config.max_pairs]
        met = sweep(base[tried], turns, gripper, around, config.body_margin)
        free = (met.inside <= config.max_points_inside) & (met.enclosed >= config.min_enclosed)
        row, turn = np.nonzero(free & allowed[tried])
        if len(row):
            kept = _steadiest(steady[tried[row]], config)
            pair = tried[row[kept]]
            grasps = turned(base, pair, turns[turn[kept]])
            found = _ranked(candidates, pair, grasps, met.enclosed[row, turn][kept])
            b = clearance(grasps, gripper, around.points[~around.own], config.clearance_cap)
            return _in_order(found, b, steady[pair], config)
    return RankedGrasps.empty()


def _ranked(
    candidates: Candidates, pair: NDArray[np.int64], grasps: Grasps, enclosed: Array
) -> RankedGrasps:
    zero = np.zeros(len(pair))
    source = np.full(len(pair), candidates.source)
    affordance, slot = candidates.affordance[pair], candidates.slot[pair]
    return RankedGrasps(grasps, affordance, slot, source, zero, enclosed, zero)


def _in_order(
    found: RankedGrasps, clearances: Array, steady: Array, config: SelectionConfig
) -> RankedGrasps:
    """Return `found` with Eq. 8's numbers, best first; the steadier first where these agree."""
    h = np.minimum(found.enclosed_height, config.enclosed_height_cap)
    score = rank_score(clearances, h, config)
    order = np.lexsort((-steady, -np.round(score, 6)))
    ranked = replace(found, clearance=clearances, enclosed_height=h, rank_score=score)
    return ranked[order]


def _reachable(
    base: Grasps, turns: Array, scene: SceneCloud, gripper: Gripper, config: SelectionConfig
) -> Mask:
    """Return (k, m) which grasps come from above the table and from the camera's side."""
    count = len(turns)
    grasps = turned(base, np.repeat(np.arange(len(base)), count), np.tile(turns, len(base)))
    fits = (grasps.width >= config.min_width) & (grasps.width <= gripper.max_width)
    along_view = np.einsum("ni,ni->n", grasps.approach, unit(grasps.translation))
    if scene.plane is None:
        fits &= along_view > np.cos(config.max_view_angle)
    else:
        fits &= along_view > np.cos(config.max_hidden_angle)
        fits &= -grasps.approach @ scene.plane.normal > np.cos(config.max_approach_angle)
        lowest = lowest_height(grasps, gripper, scene.plane)
        fits &= lowest >= config.min_table_distance
    return np.asarray(fits.reshape(len(base), count))


def _centredness(grasps: Grasps, region: RegionCloud) -> Array:
    """Return (n,) 1 for grasps about the region's middle, less toward its rim."""
    centre = np.median(region.points, axis=0)
    radius = np.percentile(np.linalg.norm(region.points - centre, axis=1), 90)
    off = np.linalg.norm(grasps.translation - centre, axis=1) / max(float(radius), 1e-3)
    return np.asarray(1.0 - OFF_CENTRE * np.minimum(off, 1.0))


def _steadiest(steady: Array, config: SelectionConfig) -> NDArray[np.int64]:
    """Return the indices of the candidates that are worth ranking, steadiest first."""
    order = np.argsort(-steady, kind="stable")[:MAX_RANKED]
    worth = steady[order] >= config.steadiness * steady.max(initial=0.0)
    return np.asarray(order[worth], np.int64)
