"""Depth images without missing pixels, for networks that take depth as it is."""

import cv2
import numpy as np

from pipelines.array_types import Singles
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane

BELOW = 0.02  # metres under the table that are still shown; deeper is background


def whole_depth(depth: Singles, intrinsics: Intrinsics, plane: Plane | None) -> Singles:
    """Return `depth` (H, W) metres, 0 where missing, with every pixel known.

    A missing pixel takes the depth of the nearest measured one. What lies beyond the table `plane`
    (camera frame) is drawn to it: the background would shift the mean that such networks subtract.
    """
    measured = depth > 0
    if not measured.any():
        return np.ones_like(depth)
    _, nearest = cv2.distanceTransformWithLabels(
        (~measured).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.zeros(int(nearest.max()) + 1, np.float32)
    of_label[nearest[measured]] = depth[measured]
    whole: Singles = of_label[nearest]
    if plane is None:
        return whole
    y, x = np.indices(depth.shape, np.float32)
    n = plane.normal.astype(np.float32)
    slope = n[0] * (x - intrinsics.cx) / intrinsics.fx + n[1] * (y - intrinsics.cy) / intrinsics.fy
    # Metres over the table at depth z: slope * z + offset; the camera is above it.
    slope = np.minimum(slope + n[2], -1e-3)
    table = (-BELOW - np.float32(plane.offset)) / slope
    return np.asarray(np.minimum(whole, table), np.float32)
