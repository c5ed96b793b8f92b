"""Input of GG-CNN: depth without missing pixels, less its mean."""

import numpy as np

from pipelines.array_types import Singles
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.sparse_depth import nearest_measured

LIMIT = 1.0  # metres from the mean
BELOW = 0.02  # metres, depth under the table that is still shown; deeper pixels are background


def normalised(depth: Singles) -> Singles:
    """Return `depth` (h, w), metres, without missing pixels, less its mean, within `LIMIT`."""
    return np.asarray(np.clip(depth - depth.mean(), -LIMIT, LIMIT), np.float32)


def whole_depth(depth: Singles, intrinsics: Intrinsics, plane: Plane | None) -> Singles:
    """Return `depth` (H, W) metres, 0 where missing, with all missing pixels filled.

    A missing pixel takes the depth of the nearest measured pixel. Points beyond the table `plane`
    (camera frame) move to the table: a background would shift the mean that the network subtracts.
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
    slope = np.minimum(slope + n[2], -1e-3)
    table = (-BELOW - np.float32(plane.offset)) / slope
    return np.asarray(np.minimum(whole, table), np.float32)
