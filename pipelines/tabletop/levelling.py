"""Level axes (right, forward, up) of a region, the frame of the network's input, and of a table.

Objects stand on tables: in these axes most planes and axes of symmetry are upright or level,
wherever the camera is (D. 69). Up is the table's normal, forward the viewing direction along the
table. The table's own frame is for users who know a camera only.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import cross, invert, make_pose, unit

UNKNOWN_UP = np.array([0.0, -1.0, -1.0]) / np.sqrt(2.0)  # a camera that looks down by 45 degrees
IMAGE_UP = np.array([0.0, -1.0, 0.0])
STEEPEST = 0.05  # sine between view and normal; below it the image's top gives the direction
LEVEL_ENOUGH = 0.2  # least sine between the table's normal and the camera axis that gives x


def level_axes(center: ArrayLike, table: Plane | None) -> Array:
    """Return R (3, 3) that turns camera axes into right, forward, up at the point `center` (3,).

    `table`: camera frame, normal up; None where no table is known.
    """
    top = UNKNOWN_UP if table is None else table.normal
    ahead = unit(np.asarray(center, np.float64))
    along = ahead - (ahead @ top) * top
    if np.linalg.norm(along) < STEEPEST:
        along = IMAGE_UP - (IMAGE_UP @ top) * top
    forward = unit(along)
    return np.stack([cross(forward, top), forward, top])


def table_row(plane: Plane | None) -> Array:
    """Return a plane as (4,): normal and offset; nan if there is no plane."""
    return np.full(4, np.nan) if plane is None else np.array([*plane.normal, plane.offset])


def table_of_row(row: ArrayLike) -> Plane | None:
    """Return the plane of a `table_row` (4,); None for nan."""
    values = np.asarray(row, np.float64)
    return Plane(values[:3], float(values[3])) if np.isfinite(values).all() else None


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
