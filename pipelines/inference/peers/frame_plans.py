"""The grasps of a compared method, assigned to regions for `grasps.h5`."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import InferConfig, SelectionConfig
from pipelines.frames.rgbd import Frame
from pipelines.grasping.feasibility.feasibility import Feasibility
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.ranking import non_maximum_suppression
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.inference.observation import Observation
from pipelines.inference.plans import Plan
from pipelines.inference.regions.regions import REST, Region
from pipelines.metrics.graspnet.graspnet_ap import NMS_ANGLE, NMS_DISTANCE

MOST_GRASPS = 300  # of a frame
MOST_COMPARED = 3000  # best grasps that enter non-maximum suppression
ON_REGION = 0.03  # metres from a region's points to the midpoint of the contacts
AS_GIVEN = np.zeros(1)  # radians: a compared method's grasps are not turned
OWN_SCORE = "own"  # the ranker: scores of the compared method

# A method that finds grasps, camera frame, in a whole frame, with the method's score (n,) of each.
# The scene has depth without the holes of sparse sensors; the generator is for random draws.
FrameMethod = Callable[[Frame, SceneCloud, np.random.Generator], tuple[GraspPoses, Array]]


def plans_of_frame(
    peer: FrameMethod,
    frame: Frame,
    observation: Observation,
    gripper: Gripper,
    config: InferConfig,
    rng: np.random.Generator,
) -> tuple[list[Region], list[Plan]]:
    """Return the regions of a frame, and for each region the grasps that `peer` finds on it.

    Grasps on no region belong to an additional last region, the rest of the image.
    """
    scene = scene_with_objects(observation)
    grasps, score = best_first(*peer(frame, scene, rng), scene)
    regions, clouds = observation.in_workspace()
    owner = region_of_each(grasps, clouds)
    if config.selects_for_compared_methods:
        kept = feasible_grasps(grasps, owner, clouds, observation.scene, gripper, config.selection)
        grasps, score, owner = grasps[kept], score[kept], owner[kept]
    kept = best_distinct(grasps)
    owner = owner[kept]
    if (owner == len(regions)).any():
        regions = [*regions, Region(~_union(regions, frame.depth.shape), 0.0, REST)]
    found = own_ranking(grasps[kept], score[kept], config.method)
    return regions, [Plan(found[owner == i]) for i in range(len(regions))]


def scene_with_objects(observation: Observation) -> SceneCloud:
    """Return the scene with the pixels of all found regions as its objects."""
    shape = observation.scene.depth.shape
    return replace(observation.scene, objects=_union(observation.regions, shape))


def _union(regions: list[Region], shape: tuple[int, ...]) -> Mask:
    masks = [region.mask for region in regions]
    return np.asarray(np.logical_or.reduce([np.zeros(shape, np.bool_), *masks]))


def best_first(grasps: GraspPoses, score: Array, scene: SceneCloud) -> tuple[GraspPoses, Array]:
    """Return the best grasps within the robot's limits, and their scores (m,).

    `score`: (n,) of `grasps`, higher is better.
    """
    order = np.argsort(-score, kind="stable")
    if scene.limits is not None:
        order = order[scene.limits.allow(grasps[order])]
    order = order[:MOST_COMPARED]
    return grasps[order], score[order]


def best_distinct(grasps: GraspPoses) -> Indices:
    """Return the indices (m,) of up to `MOST_GRASPS` of `grasps`, best first, that are not alike.

    The limits are those of GraspNet-1Billion's benchmark.
    """
    return non_maximum_suppression(grasps, NMS_DISTANCE, NMS_ANGLE)[:MOST_GRASPS]


def feasible_grasps(
    grasps: GraspPoses,
    owner: Indices,
    clouds: list[RegionCloud],
    scene: SceneCloud,
    gripper: Gripper,
    config: SelectionConfig,
) -> Indices:
    """Return the indices of grasps that our selection finds feasible at their region (Sec. III-F).

    `owner`: (n,) index in `clouds`; a grasp without a region is not feasible. The order is kept.
    """
    kept: list[Indices] = [np.zeros(0, np.int64)]
    for place, cloud in enumerate(clouds):
        own = np.flatnonzero(owner == place)
        if not len(own) or not len(cloud):
            continue
        cap = config.ranking.clearance_cap
        feasibility = Feasibility.at(cloud, scene, gripper, config.feasibility, cap)
        reached, row = feasibility.reachable(grasps[own], AS_GIVEN)
        free, _ = feasibility.first_free(reached, np.ones(len(reached)), 0.0, len(reached))
        free = free[feasibility.has_free_path(reached[free])]
        kept.append(own[row[free]])
    return np.sort(np.concatenate(kept))


def region_of_each(grasps: GraspPoses, clouds: list[RegionCloud]) -> Indices:
    """Return (n,) the region nearest to each grasp; len(clouds) if no region is near."""
    distances = [
        KDTree(cloud.points).query(grasps.translation)[0]
        if len(cloud)
        else np.full(len(grasps), np.inf)
        for cloud in clouds
    ]
    columns = np.stack([*distances, np.full(len(grasps), ON_REGION)])
    return np.asarray(columns.argmin(axis=0))


def own_ranking(grasps: GraspPoses, score: Array, method: str) -> RankedGrasps:
    """Return grasps ranked by `score`; columns that the method does not measure are 0."""
    zero = np.zeros(len(grasps))
    return RankedGrasps(
        grasps,
        affordance=zero,
        slot=np.full(len(grasps), -1),
        source=np.full(len(grasps), method),
        clearance=zero,
        enclosed_height=zero,
        rank_score=np.asarray(score, np.float64),
    )
