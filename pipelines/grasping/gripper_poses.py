"""Grasps as poses of a gripper's base, for robot programs.

The base lies behind the contacts along the approach, the axes are its own. Two conventions of axes
are in use; both have z = approach, and differ by a quarter turn about it:

* closing along x: Contact-GraspNet, 6-DOF GraspNet, ACRONYM, GraspGen
* closing along y: the links of grippers, as `panda_hand`; MoveIt, ROS and Isaac move these
"""

import numpy as np

from pipelines.array_types import Array
from pipelines.grasping.grasps import GraspPoses

# Columns: the base's x, y, z in the grasp frame (approach, closing, approach x closing).
CLOSING_ALONG_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
CLOSING_ALONG_Y = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def gripper_poses(grasps: GraspPoses, base_to_contacts: float, axes: Array) -> Array:
    """Return (n, 4, 4) poses: base of the gripper to the frame of `grasps`.

    Args:
        grasps: in any frame.
        base_to_contacts: metres along approach, from the base's origin to the contact line.
        axes: (3, 3), one of the conventions above.
    """
    poses = np.zeros((len(grasps), 4, 4))
    poses[:, :3, :3] = grasps.rotation @ axes
    poses[:, :3, 3] = grasps.translation - base_to_contacts * grasps.approach
    poses[:, 3, 3] = 1.0
    return poses
