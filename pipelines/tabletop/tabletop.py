"""Support plane and foreground of a tabletop frame."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices, Mask, Vector
from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.footprint import Footprint
from pipelines.tabletop.support_plane import SHADOW_GAPS, Affine, Support, find_support, large_parts

WARP_WINDOW = 81  # pixels over which a sensor bends a flat table
CLEARLY = 1.6  # factor on the foreground threshold for pixels that may connect two pieces
NOISE_LIMIT = 10.0  # metres of depth beyond which noise does not grow
NOISE_FACTOR = 4.0  # standard deviations by which foreground stands out
MOST_SIDES = 0.25  # side pixels below a table per pixel of it; a lid has more
NEAREST = 0.05  # quantile of the depths that counts as the nearest, against strays
MIN_COVER = 0.1  # share of the window of a mean that must have values
DEVIATION = 1.4826  # standard deviation of normal errors by their median absolute value
STRIDE = 2  # rows and columns from which a table's noise and extent are measured


@dataclass(frozen=True)
class Tabletop:
    """The support plane of a frame, and the pixels of the objects on it.

    Attributes:
        plane: camera frame, normal to the camera's side; None if there is none.
        foreground: (H, W) pixels above the plane; all near pixels if there is no plane.
        clear: (H, W) foreground that clearly stands out, without bridges of noise between objects.
        bare: (H, W) pixels measured on the plane; none if there is no plane.
        noise: standard deviation of the depth at one metre, metres; grows with z^2.
    """

    plane: Plane | None
    foreground: Mask
    clear: Mask
    bare: Mask
    noise: float

    @property
    def height_noise(self) -> float:
        """Largest height of noise over the plane, metres per metre of depth."""
        # A depth error of noise z^2 moves a point on the plane by offset / z times as much along
        # the normal.
        return 0.0 if self.plane is None else NOISE_FACTOR * self.noise * float(self.plane.offset)

    def threshold(self, z: ArrayLike, config: RegionConfig) -> Array:
        """Return the least height (...) over the plane of foreground at depth `z` (...), metres."""
        noise = np.minimum(z, NOISE_LIMIT) * self.height_noise
        return np.asarray(np.maximum(config.min_height, noise))


def find_tabletop(
    xyz: Array,
    intrinsics: Intrinsics,
    config: RegionConfig,
    rng: np.random.Generator,
    ground: Mask | None = None,
) -> Tabletop:
    """Find the support plane and the foreground of the organised cloud `xyz` (H, W, 3).

    `xyz`: metres, camera frame, nan where the depth is missing. `ground`: (H, W) pixels that may
    show the support, if known; without it an object's lid may be mistaken for the support.
    """
    z = np.ascontiguousarray(xyz[..., 2])
    near = near_pixels(z, config)
    bare = near if ground is None else near & ground
    support = find_support(xyz, bare, intrinsics, config, rng)
    no_table = Tabletop(None, near, near, np.zeros_like(near), config.plane_tolerance / 3.0)
    if support is None:
        return no_table
    residual, inliers = _near_plane(z, near, support.affine, config.plane_tolerance)
    warp = _smooth(residual, inliers)
    some = _spread(inliers)
    noise = DEVIATION * float(median(np.abs(residual.take(some) - warp.take(some))))
    tabletop = Tabletop(support.plane, near, near, inliers, noise)
    limits = config.min_height, tabletop.height_noise, config.max_height
    above, clear = _above(z, near, warp, support.affine, float(support.plane.offset), limits)
    above = np.asarray(cv2.medianBlur(above.view(np.uint8), 3)).view(np.bool_) & near
    points = xyz.reshape(-1, 3)
    # Objects in front cut a table into parts; closing joins parts that only shadows separate.
    closed = cv2.morphologyEx(inliers.view(np.uint8), cv2.MORPH_CLOSE, SHADOW_GAPS)
    large = inliers & large_parts(np.asarray(closed, np.uint8))
    extent = points.take(_spread(large), axis=0)
    table = Footprint.around(extent, support.plane, config.support_margin)
    at = np.flatnonzero(above)
    above.ravel()[at] = table.contains(points.take(at, axis=0))
    if np.count_nonzero(above) < config.min_pixels and _is_lid(z, near, inliers, support, config):
        return no_table
    return replace(tabletop, foreground=above, clear=above & clear, bare=inliers & ~above)


def _is_lid(z: Array, near: Mask, inliers: Mask, support: Support, config: RegionConfig) -> bool:
    """Return whether a plane without objects on it is an object's lid instead of a table.

    If no depth is measured around an object, its lid is the largest plane. The sides of the object
    join its lid; beyond the edge of a table the depth jumps.
    """
    rows, columns = (np.arange(count, dtype=np.float64) for count in z.shape)
    a, b, c = support.affine
    over = 1.0 / z - (a * columns + b * rows[:, None] + c)
    sides = _pixels_of_sides(
        z, near, inliers, over, 2.0 * config.plane_tolerance, config.depth_step
    )
    return bool(sides > MOST_SIDES * np.count_nonzero(inliers))


def _spread(mask: Mask) -> Indices:
    """Return the flat indices (n,) of evenly spread pixels of `mask` (H, W)."""
    thin = np.zeros_like(mask)
    thin[::STRIDE, ::STRIDE] = mask[::STRIDE, ::STRIDE]
    return np.flatnonzero(thin if thin.any() else mask)


def _smooth(values: Array, mask: Mask) -> Array:
    """Return the mean (H, W) of `values` over the pixels of `mask` in a wide window.

    `values` are 0 outside `mask`; the mean is 0 where `mask` covers at most a share of `MIN_COVER`.
    """
    size = (WARP_WINDOW, WARP_WINDOW)
    share = np.asarray(cv2.boxFilter(mask.view(np.uint8), cv2.CV_64F, size), np.float64)
    total = np.asarray(cv2.boxFilter(values, -1, size), np.float64)
    share[share <= MIN_COVER] = np.inf
    total /= share
    return total


def near_pixels(z: Array, config: RegionConfig) -> Mask:
    """Return a mask (H, W) of measured pixels in range; `z`: (H, W) metres, nan where missing."""
    measured = z > 0
    if not measured.any():
        return np.asarray(measured)
    nearest = float(quantiles(z.take(_spread(measured)), NEAREST))
    return np.asarray(measured & (z < min(config.max_distance, nearest + config.max_range)))


@compiled
def _near_plane(z: Array, near: Mask, affine: Affine, tolerance: float) -> tuple[Array, Mask]:
    """Return inverse depth minus the plane's (H, W), 0 beyond `tolerance`, and the inliers."""
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
    z: Array, near: Mask, warp: Array, affine: Affine, offset: float, limits: Vector
) -> tuple[Mask, Mask]:
    """Return masks (H, W) of the pixels above the table, and of those clearly above it.

    `warp`: (H, W) inverse depth that the sensor adds at the table. `offset`: of the plane, metres.
    `limits`: least height, metres; height of noise, metres per metre of depth; greatest height.
    """
    a, b, c = affine
    least, noise, greatest = limits
    above, clear = np.zeros(z.shape, np.bool_), np.zeros(z.shape, np.bool_)
    for row in range(z.shape[0]):
        for column in range(z.shape[1]):
            if not near[row, column]:
                continue
            depth, bent = z[row, column], warp[row, column]
            # At depth z' the height is offset z' r for a residual r; z' = 1 / (1 / z - warp).
            over = 1.0 / depth - (a * column + b * row + c) - bent
            height = over * depth * offset / (1.0 - bent * depth)
            threshold = max(least, min(depth, NOISE_LIMIT) * noise)
            above[row, column] = threshold < height < greatest
            clear[row, column] = height > CLEARLY * threshold
    return above, clear


@compiled
def _pixels_of_sides(
    z: Array, near: Mask, inliers: Mask, over: Array, tolerance: float, step: float
) -> int:
    """Return the number of pixels below a plane that are connected with the plane.

    Args:
        z: (H, W) depth in metres, nan where missing.
        near: (H, W) pixels to search.
        inliers: (H, W) pixels of the plane.
        over: (H, W) inverse depth minus the plane's.
        tolerance: inverse depth from which a pixel counts as below.
        step: largest difference of neighbours on one surface, as a share of their depth.
    """
    height, width = z.shape
    seen = inliers.copy()
    waiting = np.empty(height * width, np.int64)
    top, count = 0, 0
    for pixel in range(height * width):
        if inliers[pixel // width, pixel % width]:
            waiting[top] = pixel
            top += 1
    while top:
        top -= 1
        row, column = divmod(waiting[top], width)
        for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            y, x = row + down, column + right
            if y < 0 or x < 0 or y >= height or x >= width or seen[y, x] or not near[y, x]:
                continue
            far = abs(z[y, x] - z[row, column]) > step * z[row, column]
            if far or over[y, x] > 0.0:
                continue
            seen[y, x] = True
            count += over[y, x] < -tolerance
            waiting[top] = y * width + x
            top += 1
    return count
