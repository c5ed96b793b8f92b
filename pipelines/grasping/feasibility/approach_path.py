"""The way in: what the open hand sweeps on its approach must be free as well (D. 77).

A hand that comes along its approach takes the room of one with a longer palm, so its way is
tested as a hand is. What is near the region is known finely; the rest of the scene, which only
the way can reach, as every third pixel shows it.
"""

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.grasping.feasibility.collision import Obstacles, lowest_height, meets
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper

Mask = NDArray[np.bool_]


def keeps_off_table(
    grasps: Grasps, table: Plane, gripper: Gripper, config: SelectionConfig
) -> Mask:
    """Return (n,) which hands stay above the `table`, from `approach_distance` back to the pose."""
    swept = gripper.swept(config.approach_distance)
    return np.asarray(lowest_height(grasps, swept, table) >= config.min_table_distance)


def approach_is_free(
    grasps: Grasps,
    gripper: Gripper,
    near: Obstacles,
    scene: Obstacles,
    config: SelectionConfig,
) -> Mask:
    """Return (n,) which hands meet nothing from `approach_distance` back to their final pose.

    Args:
        grasps: n hands that are free at their final poses.
        gripper: the hand.
        near: all that is known about the region's surroundings.
        scene: the whole scene.
        config: thresholds.
    """
    swept = gripper.swept(config.approach_distance)
    free = np.ones(len(grasps), np.bool_)
    if not config.approach_distance > 0.0:
        return free
    for obstacles in (near, scene):
        still = np.flatnonzero(free)
        met, _ = meets(
            grasps[still], swept, obstacles, config.body_margin, config.max_points_inside
        )
        free[still] = ~met
    return free
