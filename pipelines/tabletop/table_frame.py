"""The table's frame: what a user means by "above the table" when only a camera is known."""

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import invert, make_pose, unit

LEVEL_ENOUGH = 0.2  # sine of the angle to the table's normal from which an axis says where x is


def table_from_camera(plane: Plane) -> Array:
    """Return `T_table_cam` (4, 4): camera to table coordinates of a support `plane`.

    The origin is the table's point nearest to the camera, z the plane's normal, x to the camera's
    right, so that y leads away from the camera; x is the camera's down where its right is no
    level direction. Metres.
    """
    z = plane.normal
    right, down = (axis - (axis @ z) * z for axis in np.eye(3)[:2])
    x = unit(right if np.linalg.norm(right) > LEVEL_ENOUGH else down)
    return invert(make_pose(np.stack([x, np.cross(z, x), z], -1), -plane.offset * z))
