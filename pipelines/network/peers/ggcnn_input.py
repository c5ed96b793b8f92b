"""Input of GG-CNN: depth without missing pixels, less its mean."""

import numpy as np
from scipy import ndimage

from pipelines.array_types import Mask, Singles
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.sparse_depth import nearest_measured

LIMIT = 1.0  # metres from the mean
BELOW = 0.02  # metres, depth under the table that is still shown; deeper pixels are background
MIN_DESCENT = 1e-3  # metres toward the table per metre of depth, of a ray that meets the table
BEHIND = 0.1  # metres behind the farthest part of the table that are still shown


def normalised(depth: Singles) -> Singles:
    """Return `depth` (h, w), metres, without missing pixels, less its mean, within `LIMIT`."""
    return np.asarray(np.clip(depth - depth.mean(), -LIMIT, LIMIT), np.float32)


def whole_depth(depth: Singles, intrinsics: Intrinsics, plane: Plane | None) -> Singles:
    """Return `depth` (H, W) metres, 0 where missing, with all missing pixels filled.

    A missing pixel takes the depth of the nearest measured pixel. Points beyond the table `plane`
    (camera frame) move to the table, and to `BEHIND` its farthest seen part at most, because
    the plane has no end: a background would shift the mean that the network subtracts.
    """
    if not (depth > 0).any():
        return np.ones_like(depth)
    whole = nearest_measured(depth)
    if plane is None:
        return whole
    y, x = np.indices(depth.shape, np.float32)
    n = plane.normal.astype(np.float32)
    slope = n[0] * (x - intrinsics.cx) / intrinsics.fx + n[1] * (y - intrinsics.cy) / intrinsics.fy
    # Metres over the table at depth z: slope * z + offset; the camera is above it.
    slope = np.minimum(slope + n[2], -MIN_DESCENT)
    offset = np.float32(plane.offset)
    table = (-BELOW - offset) / slope
    on_table = (depth > 0) & (np.abs(slope * depth + offset) < BELOW)
    return np.asarray(np.minimum(np.minimum(whole, table), _end(depth, on_table)), np.float32)


def _end(depth: Singles, on_table: Mask) -> np.float32:
    """Return the largest depth to show: a little more than that of the table's largest part."""
    parts, count = ndimage.label(on_table)
    if not count:
        return np.float32(np.inf)
    largest = parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])
    return np.float32(depth[largest].max() + BEHIND)
