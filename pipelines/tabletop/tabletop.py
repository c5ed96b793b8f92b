"""The support plane of a tabletop frame, and the foreground that stands on it."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.footprint import Footprint
from pipelines.tabletop.plane_sides import pixels_of_sides
from pipelines.tabletop.support_plane import Affine, Support, find_support

WARP_WINDOW = 81  # pixels over which a sensor bends a flat table
CLEARLY = 1.6  # heights that stand out from noise which a thing does not share with its neighbour
FAR = 10.0  # metres, from where on noise grows no more
NOISE_FACTOR = 4.0  # standard deviations that foreground stands out by
MOST_SIDES = 0.25  # pixels that hang down from a table, a pixel of it; from lids it is more
THIN = 2  # every so many-th row and column tells of a table's noise and extent


@dataclass(frozen=True)
class Tabletop:
    """What a frame shows: the plane that things stand on, and the pixels of these things.

    Attributes:
        plane: camera frame, normal to the camera's side; None where there is none.
        foreground: (H, W) pixels above the plane (all near pixels where there is no plane).
        clear: (H, W) the foreground that stands out well; bridges of noise between things do not.
        noise: metres, standard deviation of the depth at one metre; grows with z^2.
    """

    plane: Plane | None
    foreground: Mask
    clear: Mask
    noise: float

    @property
    def doubt(self) -> float:
        """Height over the plane that noise makes up, in metres a metre of depth."""
        # Depth errs by noise z^2 along the ray, whose cosine to the normal is offset / z.
        return 0.0 if self.plane is None else NOISE_FACTOR * self.noise * float(self.plane.offset)

    def threshold(self, z: ArrayLike, config: RegionConfig) -> Array:
        """Return (...) the height over the plane that stands out from noise at depth `z` (...)."""
        return np.asarray(np.maximum(config.min_height, np.minimum(z, FAR) * self.doubt))


def find_tabletop(
    xyz: Array,
    intrinsics: Intrinsics,
    config: RegionConfig,
    rng: np.random.Generator,
    ground: Mask | None = None,
) -> Tabletop:
    """Find the support plane and the foreground of the organised cloud `xyz` (H, W, 3).

    `xyz`: metres, camera frame, nan where the depth is missing. `ground`: (H, W) the pixels that
    may show the support, where that is known: without them an object's lid may be taken for it.
    """
    z = np.ascontiguousarray(xyz[..., 2])
    near = near_pixels(z, config)
    bare = near if ground is None else near & ground
    support = find_support(xyz, bare, intrinsics, config, rng)
    if support is None:
        return Tabletop(None, near, near, config.plane_tolerance / 3.0)
    residual, inliers = _near_plane(z, near, support.affine, config.plane_tolerance)
    warp = _smooth(residual, inliers)
    some = _spread(inliers)
    noise = 1.4826 * float(median(np.abs(residual.take(some) - warp.take(some))))
    top = Tabletop(support.plane, near, near, noise)
    limits = config.min_height, top.doubt, config.max_height
    above, clear = _above(z, near, warp, support.affine, float(support.plane.offset), limits)
    above = np.asarray(cv2.medianBlur(above.view(np.uint8), 3)).view(np.bool_) & near
    points = xyz.reshape(-1, 3)
    extent = points.take(_spread(_large_parts(inliers)), axis=0)
    table = Footprint.around(extent, support.plane, config.support_margin)
    at = _places(above, 1)
    above.ravel()[at] = table.contains(points.take(at, axis=0))
    if np.count_nonzero(above) < config.min_pixels and _is_lid(z, near, inliers, support, config):
        return Tabletop(None, near, near, config.plane_tolerance / 3.0)
    return replace(top, foreground=above, clear=above & clear)


def _is_lid(z: Array, near: Mask, inliers: Mask, support: Support, config: RegionConfig) -> bool:
    """Return whether a plane on which nothing stands is a face of a thing instead of a table.

    Where no depth is measured beside an object, its lid is the largest plane; its sides hang down
    from it. Beyond the edge of a table the depth jumps.
    """
    rows, columns = (np.arange(count, dtype=np.float64) for count in z.shape)
    a, b, c = support.affine
    over = 1.0 / z - (a * columns + b * rows[:, None] + c)
    sides = pixels_of_sides(z, near, inliers, over, 2.0 * config.plane_tolerance, config.depth_step)
    return bool(sides > MOST_SIDES * np.count_nonzero(inliers))


def _spread(mask: Mask) -> Indices:
    """Return (n,) places, counted row by row, of some pixels of `mask` (H, W), evenly spread."""
    some = _places(mask, THIN)
    return some if len(some) else _places(mask, 1)


def _smooth(values: Array, mask: Mask) -> Array:
    """Return (H, W) the mean of `values`, 0 outside `mask`, over its pixels in a wide window.

    0 where the mask covers no more than a tenth of the window.
    """
    size = (WARP_WINDOW, WARP_WINDOW)
    share = np.asarray(cv2.boxFilter(mask.view(np.uint8), cv2.CV_64F, size), np.float64)
    total = np.asarray(cv2.boxFilter(values, -1, size), np.float64)
    share[share <= 0.1] = np.inf
    total /= share
    return total


def near_pixels(z: Array, config: RegionConfig) -> Mask:
    """Return the (H, W) pixels that are measured and within reach; `z` (H, W), nan if missing."""
    measured = z > 0
    if not measured.any():
        return np.asarray(measured)
    nearest = float(quantiles(z.take(_spread(measured)), 0.05))
    return np.asarray(measured & (z < min(config.max_distance, nearest + config.max_range)))


def _large_parts(mask: Mask) -> Mask:
    # Objects in front cut a table into parts; closing joins what only their shadows part.
    closed = cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    count, labels = cv2.connectedComponents(closed, connectivity=8)
    if count < 2:
        return mask
    return _in_large(np.asarray(labels, np.int32), count, mask)


@compiled
def _places(mask: Mask, step: int) -> Indices:
    """Return (n,) where pixels of `mask` (H, W) in every so many-th row and column are."""
    height, width = mask.shape
    places = np.empty(((height + step - 1) // step) * ((width + step - 1) // step), np.int64)
    count = 0
    for row in range(0, height, step):
        for column in range(0, width, step):
            if mask[row, column]:
                places[count] = row * width + column
                count += 1
    return places[:count]


@compiled
def _in_large(labels: NDArray[np.int32], count: int, mask: Mask) -> Mask:
    """Return (H, W) the pixels of `mask` in parts of over a tenth of the largest's area."""
    area, last, run = np.zeros(count, np.int64), np.int32(0), 0
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):  # added once a run: a third of the time
            if labels[row, column] != last:
                area[last] += run
                last, run = labels[row, column], 0
            run += 1
    area[last] += run
    area[0] = 0  # what is no part
    large = area > 0.1 * area.max()
    result = np.empty_like(mask)
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):
            result[row, column] = mask[row, column] and large[labels[row, column]]
    return result


@compiled
def _near_plane(z: Array, near: Mask, affine: Affine, tolerance: float) -> tuple[Array, Mask]:
    """Return (H, W) inverse depth over the plane's where it is within `tolerance`; and where."""
    a, b, c = affine
    residual, inliers = np.zeros(z.shape), np.zeros(z.shape, np.bool_)
    for row in range(z.shape[0]):
        for column in range(z.shape[1]):
            over = 1.0 / z[row, column] - (a * column + b * row + c)
            if near[row, column] and abs(over) < tolerance:
                residual[row, column] = over
                inliers[row, column] = True
    return residual, inliers


@compiled
def _above(
    z: Array, near: Mask, warp: Array, affine: Affine, offset: float, limits: Affine
) -> tuple[Mask, Mask]:
    """Return (H, W) which pixels are above the table, and which of them clearly.

    `warp`: (H, W) inverse depth that the sensor adds to the table's. `offset`: of its plane.
    `limits`: least height, height that noise makes up a metre of depth, greatest height.
    """
    a, b, c = affine
    least, doubt, greatest = limits
    above, clear = np.zeros(z.shape, np.bool_), np.zeros(z.shape, np.bool_)
    for row in range(z.shape[0]):
        for column in range(z.shape[1]):
            if not near[row, column]:
                continue
            depth, bent = z[row, column], warp[row, column]
            # At depth z' the height is offset z' r for a residual r; z' = 1 / (1 / z - warp).
            over = 1.0 / depth - (a * column + b * row + c) - bent
            height = over * depth * offset / (1.0 - bent * depth)
            threshold = max(least, min(depth, FAR) * doubt)
            above[row, column] = threshold < height < greatest
            clear[row, column] = height > CLEARLY * threshold
    return above, clear
