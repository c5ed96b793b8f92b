"""The bodies of a gripper against observed points: collision, enclosed height, clearance.

Points are sorted into cubes (`PointCells`). A gripper meets few cubes, and only their points are
tested one by one, until too many are inside the bodies.
"""

import numpy as np

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.configs import FeasibilityConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.grasping.feasibility.gripper_bodies import (
    first_free_grasps,
    frames_about,
    nearest_gaps,
    points_met,
    points_reach,
)
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.obstacles import Obstacles


def bodies_meet(
    grasps: GraspPoses, gripper: Gripper, obstacles: Obstacles, config: FeasibilityConfig
) -> tuple[Mask, Array]:
    """Return a mask (n,) of the colliding grasps, and the enclosed heights (n,) of all.

    The enclosed height is how far points between the fingers reach in from the tips, metres; 0
    without points and for colliding grasps.
    """
    frames, bounds = _bodies(grasps, gripper, obstacles)
    test = np.float32(config.body_margin), config.max_points_inside, obstacles.cells
    met, enclosed = points_met(frames, bounds, *test)
    return met, enclosed.astype(np.float64)


def first_free(
    grasps: GraspPoses,
    gripper: Gripper,
    obstacles: Obstacles,
    config: FeasibilityConfig,
    stability: Array,
    wanted: tuple[float, int],
) -> tuple[Indices, Array]:
    """Return indices (f,) of free grasps that hold something, and enclosed heights (f,), metres.

    The most stable grasps, by `stability` (n,), come first. `wanted`: the share of the first free
    grasp's stability that other grasps need, and the most grasps to return, which end the search.
    """
    frames, bounds = _bodies(grasps, gripper, obstacles)
    test = np.float32(config.body_margin), config.max_points_inside, obstacles.cells
    least = config.min_enclosed, *wanted
    free, enclosed = first_free_grasps(frames, bounds, *test, stability, least)
    return free, enclosed.astype(np.float64)


def clearance(grasps: GraspPoses, gripper: Gripper, obstacles: Obstacles, cap: float) -> Array:
    """Return the distance (n,) of the gripper from the nearest point, at most `cap` metres."""
    frames, bounds = _bodies(grasps, gripper, obstacles)
    gaps = nearest_gaps(frames, bounds, np.float32(cap), obstacles.cells)
    return np.asarray(np.minimum(gaps.astype(np.float64), cap))


def reach_between(
    grasps: GraspPoses, gripper: Gripper, obstacles: Obstacles, config: FeasibilityConfig
) -> Array:
    """Return how far points between the open fingers are off the midpoint (n, 2), metres.

    First against the closing axis, then along it; 0 without such points. `max_points_inside` points
    at each side are taken as noise.
    """
    frames, bounds = _bodies(grasps, gripper, obstacles)
    reach = points_reach(frames, bounds, config.max_points_inside, obstacles.cells)
    return reach.astype(np.float64)


def lowest_height(grasps: GraspPoses, gripper: Gripper, plane: Plane) -> Array:
    """Return the height (n,) of the gripper's lowest corner over `plane`, negative below."""
    back, tip, palm_back, front, half, palm_half, _, outer, side = gripper.bounds(grasps.width).T
    along, across, binormal = np.einsum("i,nij->jn", plane.normal, grasps.rotation)
    across, binormal = np.abs(across), np.abs(binormal)
    fingers = np.minimum(back * along, tip * along) - outer * across - half * binormal
    palm = np.minimum(palm_back * along, front * along) - side * across - palm_half * binormal
    return np.asarray(plane.height(grasps.translation) + np.minimum(fingers, palm))


def _bodies(grasps: GraspPoses, gripper: Gripper, obstacles: Obstacles) -> tuple[Singles, Singles]:
    """Return matrices (n, 3, 4) from `obstacles.center` into grasp frames, and bounds (n, 9)."""
    rotation, translation = map(np.ascontiguousarray, (grasps.rotation, grasps.translation))
    frames = frames_about(rotation, translation, obstacles.center)
    return frames, gripper.bounds(grasps.width).astype(np.float32)
