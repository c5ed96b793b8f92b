"""The grasps of a compared method, region by region as `grasps.h5` has them."""

import numpy as np
from scipy.spatial import KDTree

from pipelines.array_types import Array, Indices
from pipelines.frames.rgbd import Frame
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.ranked_grasps import RankedGrasps
from pipelines.grasping.ranking.suppression import non_maximum_suppression
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.inference.observation import Observation
from pipelines.inference.peers.frame_method import FrameMethod
from pipelines.inference.plans import Plan
from pipelines.inference.regions import REST, Region

MOST_GRASPS = 300  # of a frame
NMS_DISTANCE, NMS_ANGLE = 0.03, float(np.radians(30.0))  # as GraspNet-1Billion's benchmark has them
MOST_COMPARED = 3000  # grasps, the best, among which alike ones are sought
ON_REGION = 0.03  # metres from a region's points to the contacts' middle
OWN_SCORE = "own"  # the origin of the scores: the method's


def plans_of_whole(
    peer: FrameMethod, frame: Frame, seen: Observation, method: str, rng: np.random.Generator
) -> tuple[list[Region], list[Plan]]:
    """Return the regions of a frame, and of the grasps that `peer` finds those on each.

    Grasps on none of them belong to a last region, the rest of the image. `method`: the name.
    """
    grasps, score = chosen_grasps(*peer.grasps(frame, seen.scene, rng), seen.scene)
    regions, clouds = seen.in_workspace()
    owner = region_of_each(grasps, clouds)
    if (owner == len(regions)).any():
        taken = [region.mask for region in regions]
        rest = ~np.logical_or.reduce([np.zeros(frame.depth.shape, bool), *taken])
        regions = [*regions, Region(rest, 0.0, REST)]
    found = own_ranking(grasps, score, method)
    return regions, [Plan(found[owner == i]) for i in range(len(regions))]


def chosen_grasps(grasps: GraspPoses, score: Array, scene: SceneCloud) -> tuple[GraspPoses, Array]:
    """Return the best grasps, no two alike, within the robot's limits, and their scores."""
    order = np.argsort(-score, kind="stable")
    if scene.limits is not None:
        order = order[scene.limits.allow(grasps[order])]
    order = order[:MOST_COMPARED]
    kept = non_maximum_suppression(
        grasps[order], NMS_DISTANCE, NMS_ANGLE, lambda some: np.ones(len(some), bool)
    )
    order = order[kept[:MOST_GRASPS]]
    return grasps[order], score[order]


def region_of_each(grasps: GraspPoses, clouds: list[RegionCloud]) -> Indices:
    """Return (n,) the region nearest to each grasp; len(clouds) where none is near."""
    distances = [
        KDTree(cloud.points).query(grasps.translation)[0]
        if len(cloud)
        else np.full(len(grasps), np.inf)
        for cloud in clouds
    ]
    columns = np.stack([*distances, np.full(len(grasps), ON_REGION)])
    return np.asarray(columns.argmin(axis=0))


def own_ranking(grasps: GraspPoses, score: Array, method: str) -> RankedGrasps:
    """Return grasps with their scores; what the method does not measure is 0."""
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
