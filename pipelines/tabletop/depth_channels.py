"""Geometry of a depth image as input channels of a convolutional network.

Surface orientation and height over the table look the same in rendered and in measured frames,
unlike colours: a detector trained on rendered geometry also works on measured frames.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask, Singles
from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.organized import image_normals
from pipelines.tabletop.sparse_depth import nearest_measured
from pipelines.tabletop.tabletop import find_tabletop

CHANNEL_NAMES = ("normal_x", "normal_y", "upright", "height", "step", "missing")
FIT_RADIUS = 2  # pixels around a pixel to which its normal is fitted
HEIGHT_UNIT = 0.08  # metres over the table per unit of the channel `height`
STEP_UNIT = 0.01  # metres of depth beyond the mean of 5 x 5 pixels per unit of the channel `step`
FAR = 90  # percentile of the depth at which the plane lies where no support is found
LIMIT = 3.0  # channels are clipped to +-LIMIT


@dataclass(frozen=True)
class SmallFrame:
    """A frame at the working size of the detector.

    Attributes:
        color: (h, w, 3) uint8 RGB; zeros if the detector does not use colour.
        depth: (h, w) float32 metres, 0 = missing.
        intrinsics: intrinsics of both images.
    """

    color: NDArray[np.uint8]
    depth: Singles
    intrinsics: Intrinsics


def shrink(
    color: NDArray[np.uint8] | None,
    depth: Singles,
    intrinsics: Intrinsics,
    min_size: int,
    max_size: int,
) -> SmallFrame:
    """Return the frame resized so that its sides fit `min_size` and `max_size`, both pixels.

    Colour is averaged; depth takes the nearest pixel, since an average across an edge would lie
    between the surfaces. `color`: None if the detector does not use it.
    """
    sides = intrinsics.width, intrinsics.height
    scale = min(min_size / min(sides), max_size / max(sides))
    width, height = (max(1, round(scale * side)) for side in sides)
    small = intrinsics.resized(width, height)
    if color is None:
        color = np.zeros((height, width, 3), np.uint8)
    averaged = cv2.resize(color, (width, height), interpolation=cv2.INTER_AREA)
    picked = cv2.resize(depth, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    return SmallFrame(np.asarray(averaged, np.uint8), np.asarray(picked, np.float32), small)


def height_plane(frame: SmallFrame) -> Plane:
    """Return the plane, camera frame, over which heights are measured: the support plane.

    If there is none, the plane faces the camera at the percentile `FAR` of depth.
    """
    xyz = frame.intrinsics.backproject(frame.depth)
    plane = find_tabletop(xyz, frame.intrinsics, RegionConfig(), np.random.default_rng(0)).plane
    if plane is not None:
        return plane
    known = frame.depth[frame.depth > 0]
    far = float(np.percentile(known, FAR)) if len(known) else 1.0
    return Plane(np.array([0.0, 0.0, -1.0]), far)


def depth_channels(depth: Singles, intrinsics: Intrinsics, plane: Plane) -> Singles:
    """Return the channels (6, h, w) float32 of `CHANNEL_NAMES`, each about one unit large.

    Missing depth takes the value of the nearest measured pixel and is marked in `missing`. A frame
    without any depth gives zeros, all marked missing.
    """
    missing = ~(depth > 0)
    if missing.all():
        channels = np.zeros((len(CHANNEL_NAMES), *depth.shape), np.float32)
        channels[-1] = 1.0
        return channels
    smooth = np.asarray(cv2.medianBlur(depth.astype(np.float32), 3), np.float32)
    filled = nearest_measured(np.where(missing, np.float32(0.0), smooth), mask_size=3)
    rays = intrinsics.image_plane
    normals = image_normals(filled, *rays, FIT_RADIUS)
    blurred = np.asarray(cv2.blur(filled, (5, 5)), np.float32)
    place = (*plane.normal.tolist(), float(plane.offset))
    return np.moveaxis(_channels(filled, blurred, missing, normals, rays, place), -1, 0)


@compiled
def _channels(
    depth: Singles,
    blurred: Singles,
    missing: Mask,
    normals: Array,
    rays: tuple[Array, Array],
    plane: tuple[float, float, float, float],
) -> Singles:
    """Return the channels (h, w, 6); `missing` (h, w) marks the pixels without measured depth.

    `rays`: x (w,) of columns and y (h,) of rows at depth 1. `plane`: normal and offset.
    """
    height, width = depth.shape
    channels = np.empty((height, width, 6), np.float32)
    for row in range(height):
        for column in range(width):
            z = np.float64(depth[row, column])
            nx, ny, nz = normals[row, column, 0], normals[row, column, 1], normals[row, column, 2]
            if np.isnan(nx):
                nx, ny, nz = 0.0, 0.0, 0.0
            channels[row, column, 0], channels[row, column, 1] = nx, ny
            channels[row, column, 2] = plane[0] * nx + plane[1] * ny + plane[2] * nz
            ray = plane[0] * rays[0][column] + plane[1] * rays[1][row] + plane[2]
            above = min(max((ray * z + plane[3]) / HEIGHT_UNIT, -LIMIT), LIMIT)
            # The root stretches heights near the table, so that thin objects stand out.
            channels[row, column, 3] = np.copysign(np.sqrt(abs(above)), above)
            step = (depth[row, column] - blurred[row, column]) / np.float32(STEP_UNIT)
            channels[row, column, 4] = min(max(step, np.float32(-LIMIT)), np.float32(LIMIT))
            channels[row, column, 5] = np.float32(missing[row, column])
    return channels
