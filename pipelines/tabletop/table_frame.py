"""The table frame: for users who know a camera only, and mean heights above the table."""

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import invert, make_pose, unit

LEVEL_ENOUGH = 0.2  # least sine between the table's normal and the camera axis that gives x


def table_from_camera(plane: Plane) -> Array:
    """Return `T_table_cam` (4, 4): camera to table coordinates of a support `plane`, metres.

    The origin is the point of the table nearest to the camera, z the plane's normal, x the camera's
    right along the table, so y leads away from the camera. If the camera's right is nearly along
    the normal, x is the camera's down.
    """
    z = plane.normal
    right, down = (axis - (axis @ z) * z for axis in np.eye(3)[:2])
    x = unit(right if np.linalg.norm(right) > LEVEL_ENOUGH else down)
    return invert(make_pose(np.stack([x, np.cross(z, x), z], -1), -plane.offset * z))
