"""Planar grasp labels, `rect/NNNN.npy`: labelled grasps that approach along the view axis.

GraspNet-1Billion's conversion: a row (see `graspnet_labels.RECT_COLUMNS`) holds the rectangle's
centre, the middle of one short side and its height, in pixels, then the score and the object id.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.dataset.graspnet.graspnet_labels import RECT_COLUMNS, GraspLabel
from pipelines.dataset.graspnet.graspnet_views import generate_views, view_rotations
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import rotate_vectors, transform_points
from pipelines.synthesis.labels.graspnet_gripper import HALF_HEIGHT

MIN_ALONG_VIEW = 0.99  # cosine between approach and view axis: 8 degrees
BASE = 0.02  # metres behind the grasp's origin at which the rectangle is drawn
SCORE_WITHOUT_FRICTION = 1.1  # the score is 1.1 - friction, higher is better


@dataclass(frozen=True)
class FreeGrasps:
    """Grasps of one object of a scene that hold without collision, object frame, metres."""

    object_id: int
    view: Indices  # (n,) index into the template of views
    rotation: Array  # (n, 3, 3) columns approach, closing, approach x closing
    origin: Array  # (n, 3) GraspNet's origin
    opening: Array  # (n,)
    min_friction: Array  # (n,)


def free_grasps(object_id: int, label: GraspLabel, collision: Mask) -> FreeGrasps:
    """Select the grasps of `label` that hold and are not in `collision` (P, 300, 12, 4)."""
    point, view, angle, depth = np.nonzero((label.min_friction > 0) & ~collision)
    return FreeGrasps(
        object_id,
        view,
        view_rotations()[view, angle].astype(np.float64),
        label.points[point].astype(np.float64),
        label.offsets[point, view, angle, depth, 2].astype(np.float64),
        label.min_friction[point, view, angle, depth].astype(np.float64),
    )


def planar_rows(grasps: FreeGrasps, T_cam_obj: Array, intrinsics: Intrinsics) -> Array:
    """Return the rows (m, 7), pixels, of the grasps that approach along the view axis."""
    along = -generate_views().astype(np.float64) @ T_cam_obj[2, :3]
    level = np.flatnonzero(along[grasps.view] > MIN_ALONG_VIEW)
    if not len(level):
        return np.zeros((0, RECT_COLUMNS))
    axes = rotate_vectors(T_cam_obj, grasps.rotation[level].swapaxes(1, 2))  # (m, axis, 3)
    origin = transform_points(T_cam_obj, grasps.origin[level])
    middle = origin - BASE * axes[:, 0]
    side = middle - 0.5 * grasps.opening[level, None] * axes[:, 1]
    corners = [side + sign * HALF_HEIGHT * axes[:, 2] for sign in (-1.0, 1.0)]
    centre, opened, low, high = (intrinsics.project(p) for p in (middle, side, *corners))
    rows = np.column_stack(
        [
            centre,
            opened,
            np.linalg.norm(high - low, axis=1),
            SCORE_WITHOUT_FRICTION - grasps.min_friction[level],
            np.full(len(level), grasps.object_id),
        ]
    )
    inside = (centre >= 0).all(axis=1)
    inside &= (centre[:, 0] < intrinsics.width) & (centre[:, 1] < intrinsics.height)
    return rows[inside]
