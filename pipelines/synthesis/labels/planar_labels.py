"""Planar grasp labels, `rect/NNNN.npy`: labelled grasps that approach along the view axis.

GraspNet-1Billion's conversion: a row (see `graspnet_labels.RECT_COLUMNS`) holds the rectangle's
centre, the middle of one short side and its height, in pixels, then the score and the object id.
"""

import numpy as np

from pipelines.array_types import Array
from pipelines.dataset.graspnet.graspnet_labels import RECT_COLUMNS, LabelledGrasps
from pipelines.dataset.graspnet.graspnet_views import generate_views
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import rotate_vectors, transform_points
from pipelines.grasping.peers.rectangles import SCORE_AT_ZERO
from pipelines.synthesis.labels.graspnet_gripper import HALF_HEIGHT

MIN_ALONG_VIEW = 0.99  # cosine between approach and view axis: 8 degrees
BASE = 0.02  # metres behind the grasp's origin at which the rectangle is drawn


def planar_rows(
    object_id: int, grasps: LabelledGrasps, T_cam_obj: Array, intrinsics: Intrinsics
) -> Array:
    """Return the rows (m, 7), pixels, of an object's grasps that approach along the view axis."""
    along = -generate_views().astype(np.float64) @ T_cam_obj[2, :3]
    level = np.flatnonzero(along[grasps.index[:, 1]] > MIN_ALONG_VIEW)
    if not len(level):
        return np.zeros((0, RECT_COLUMNS))
    rotation, origin, opening, friction = (
        column[level].astype(np.float64)
        for column in (grasps.rotation, grasps.origin, grasps.opening, grasps.min_friction)
    )
    axes = rotate_vectors(T_cam_obj, rotation.swapaxes(1, 2))  # (m, axis, 3)
    origin = transform_points(T_cam_obj, origin)
    middle = origin - BASE * axes[:, 0]
    side = middle - 0.5 * opening[:, None] * axes[:, 1]
    corners = [side + sign * HALF_HEIGHT * axes[:, 2] for sign in (-1.0, 1.0)]
    center, opened, low, high = (intrinsics.project(p) for p in (middle, side, *corners))
    rows = np.column_stack(
        [
            center,
            opened,
            np.linalg.norm(high - low, axis=1),
            SCORE_AT_ZERO - friction,
            np.full(len(level), object_id),
        ]
    )
    inside = (center >= 0).all(axis=1)
    inside &= (center[:, 0] < intrinsics.width) & (center[:, 1] < intrinsics.height)
    return rows[inside]
