"""The support plane of a tabletop frame, and the foreground that stands on it.

A plane is affine in inverse depth: 1/z = a u + b v + c. Stereo and structured light measure with
nearly constant noise there, so planes are fitted and judged in inverse depth, and a tolerance of
`t` metres at one metre means t z^2 metres at depth z.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import basis_from_direction

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_PLANES = 4  # candidates that are drawn one after the other
ITERATIONS = 300  # hypotheses a candidate
SAMPLE = 4000  # pixels that hypotheses are counted on
MIN_PIXELS = 200  # fewer show no plane
WARP_WINDOW = 81  # pixels over which a sensor bends a flat table
CLEARLY = 1.6  # heights that stand out from noise which a thing does not share with its neighbour
NOISE_FACTOR = 4.0  # standard deviations that foreground stands out by
THIN = 2  # every so many-th row and column tells of a table's noise and extent
CELL = 0.01  # metres, of the grid on the plane that its extent is drawn into


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

    def threshold(self, z: ArrayLike, config: RegionConfig) -> Array:
        """Return (...) the height over the plane that stands out from noise at depth `z` (...)."""
        offset = 0.0 if self.plane is None else self.plane.offset
        # Depth errs by noise z^2 along the ray, whose cosine to the normal is offset / z.
        error = np.minimum(z, 10.0) * (NOISE_FACTOR * self.noise * offset)
        return np.asarray(np.maximum(config.min_height, error))


def find_tabletop(
    xyz: Array, intrinsics: Intrinsics, config: RegionConfig, rng: np.random.Generator
) -> Tabletop:
    """Find the support plane and the foreground of the organised cloud `xyz` (H, W, 3).

    `xyz`: metres, camera frame, nan where the depth is missing.
    """
    z = np.ascontiguousarray(xyz[..., 2])
    near = near_pixels(z, config)
    support = _find_support(xyz, near, intrinsics, config, rng)
    if support is None:
        return Tabletop(None, near, near, config.plane_tolerance / 3.0)
    residual = support.residual(z)  # nan, like z, where nothing was measured; never near
    inliers = near & (np.abs(residual) < config.plane_tolerance)
    warp = _smooth(residual, inliers)
    residual -= warp
    noise = 1.4826 * float(np.median(np.abs(_thinned(residual, inliers))))
    height = _heights(residual, warp, z, support.plane)
    top = Tabletop(support.plane, near, near, noise)
    threshold = top.threshold(z, config)
    above = near & (height > threshold) & (height < config.max_height)
    above = cv2.medianBlur(above.astype(np.uint8), 3) > 0
    above &= near
    large = _large_parts(inliers)
    extent = [_thinned(xyz[..., axis], large) for axis in range(3)]
    table = Footprint.around(np.stack(extent).T, support.plane, config.support_margin)
    above[above] = table.contains(np.stack([xyz[..., axis][above] for axis in range(3)]).T)
    return replace(top, foreground=above, clear=above & (height > CLEARLY * threshold))


def _heights(residual: Array, warp: Array, z: Array, plane: Plane) -> Array:
    """Return (H, W) heights over the table, in metres, of its pixels made flat.

    `residual`: (H, W) inverse depth over the plane's, already less `warp`, the sensor's.
    """
    # At depth z' the height is offset z' r for a residual r; z' = 1 / (1 / z - warp).
    height = residual * z
    height *= plane.offset
    height /= 1.0 - warp * z
    return height


def _thinned(values: Array, mask: Mask) -> Array:
    """Return (n,) `values` (H, W) at some pixels of `mask` (H, W), evenly spread."""
    some = values[::THIN, ::THIN][mask[::THIN, ::THIN]]
    return some if len(some) else values[mask]


def _smooth(values: Array, mask: Mask) -> Array:
    """Return (H, W) the mean of `values` over the pixels of `mask` in a wide window, else 0."""
    size = (WARP_WINDOW, WARP_WINDOW)
    weight = np.asarray(cv2.boxFilter(mask.astype(np.uint8), cv2.CV_64F, size), np.float64)
    total = np.asarray(cv2.boxFilter(np.where(mask, values, 0.0), -1, size), np.float64)
    total[weight <= 0.1] = 0.0
    total /= np.maximum(weight, 0.1, out=weight)
    return total


def near_pixels(z: Array, config: RegionConfig) -> Mask:
    """Return the (H, W) pixels that are measured and within reach; `z` (H, W), nan if missing."""
    measured = z > 0
    if not measured.any():
        return np.asarray(measured)
    nearest = float(np.percentile(_thinned(z, measured), 5))
    return np.asarray(measured & (z < min(config.max_distance, nearest + config.max_range)))


@dataclass(frozen=True)
class Footprint:
    """The convex hull of points on a plane, widened by a margin, drawn into a grid of cells."""

    axes: Array  # (3, 2) along the plane
    low: Array  # (2,) metres, corner of the grid
    cells: NDArray[np.uint8]

    @classmethod
    def around(cls, points: Array, plane: Plane, margin: float) -> "Footprint":
        """Return the footprint of `points` (n, 3) on `plane`; `margin` in metres."""
        axes = basis_from_direction(plane.normal)[:, 1:]
        if len(points) < 3:
            return cls(axes, np.zeros(2), np.zeros((1, 1), np.uint8))
        flat = axes.T @ points.T  # a row an axis: several times faster to go through
        low = flat.min(axis=1) - margin - CELL
        width, height = ((flat.max(axis=1) - low + margin) / CELL).astype(int) + 2
        cells = np.zeros((height, width), np.uint8)
        columns, rows = ((flat - low[:, None]) / CELL).astype(np.int32)
        cells[rows, columns] = 1
        cv2.fillConvexPoly(cells, cv2.convexHull(_ends_of_rows(cells)), 1)
        size = 2 * round(margin / CELL) + 1
        wide = cv2.dilate(cells, np.ones((size, size), np.uint8))
        return cls(axes, low, np.asarray(wide, np.uint8))

    def contains(self, points: Array) -> Mask:
        """Return which of `points` (n, 3) lie over it."""
        flat = self.axes.T @ points.T
        columns, rows = np.floor((flat - self.low[:, None]) / CELL).astype(np.int64)
        height, width = self.cells.shape
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        cell = np.where(inside, rows * width + columns, 0)
        return np.asarray(inside & (self.cells.take(cell) > 0))


def _ends_of_rows(cells: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return (n, 2) the first and last set cell (column, row) of each row: the hull's corners."""
    rows = np.flatnonzero(cells.any(axis=1))
    first = cells[rows].argmax(axis=1)
    last = cells.shape[1] - 1 - cells[rows, ::-1].argmax(axis=1)
    ends = np.concatenate([np.stack([first, rows], 1), np.stack([last, rows], 1)])
    return ends.astype(np.int32)


@dataclass(frozen=True)
class _Support:
    """A plane as 1/z = a u + b v + c over an image, and the noise about it."""

    coefficients: Array
    plane: Plane
    noise: float

    def residual(self, z: Array) -> Array:
        """Return (H, W) inverse depth over the plane's; `z` (H, W) metres."""
        v, u = np.arange(z.shape[0], dtype=float)[:, None], np.arange(z.shape[1], dtype=float)
        return np.asarray(1.0 / z - _evaluate(self.coefficients, u, v))


def _find_support(
    xyz: Array, near: Mask, intrinsics: Intrinsics, config: RegionConfig, rng: np.random.Generator
) -> _Support | None:
    """Return the best of `MAX_PLANES` candidates; None where none is big enough.

    Candidates are drawn in turn from what earlier ones left. The best has most pixels, near ones
    counting more; what is seen beneath a plane's own extent speaks against it, because things
    stand on a table and nothing is seen through it.
    """
    at = np.flatnonzero(near)
    if len(at) < MIN_PIXELS:
        return None
    at = at[rng.choice(len(at), min(len(at), 5 * SAMPLE), replace=False)]
    v, u = (place.astype(np.float64) for place in np.divmod(at, near.shape[1]))
    points = np.ascontiguousarray(xyz.reshape(-1, 3)[at].T)
    disparity = 1.0 / points[2]
    weight = disparity**2 / (disparity**2).sum()
    best, best_value, left = None, config.min_plane_share, np.ones(len(u), bool)
    for _ in range(MAX_PLANES):
        if left.sum() < MIN_PIXELS or weight[left].sum() <= best_value:  # none can be better
            break
        coefficients = _ransac(u[left], v[left], disparity[left], config.plane_tolerance, rng)
        residual = disparity - _evaluate(coefficients, u, v)
        inliers = np.abs(residual) < config.plane_tolerance
        if (inliers & left).sum() < MIN_PIXELS / 10:
            break
        plane = _plane_of(coefficients, intrinsics)
        beneath = _seen_through(points, residual < -2.0 * config.plane_tolerance, plane, inliers)
        value = weight[inliers & left].sum() - config.beneath_weight * weight[beneath].sum()
        value *= _facing_weight(plane)
        if value > best_value:
            noise = 1.4826 * float(np.median(np.abs(residual[inliers])))
            best, best_value = _Support(coefficients, plane, noise), value
        left &= ~inliers
    return best


def _seen_through(points: Array, behind: Mask, plane: Plane, inliers: Mask) -> Mask:
    """Return which of `points` (3, n) that are `behind` the plane are seen through its extent."""
    crossing = points[:, behind]
    along = plane.normal @ crossing
    crossing *= -plane.offset / np.where(along < 0, along, -1e-9)
    result = behind.copy()
    extent = points[:, np.flatnonzero(inliers)[:SAMPLE]]
    result[behind] = Footprint.around(extent.T, plane, 0.0).contains(crossing.T)
    return result


def _facing_weight(plane: Plane) -> float:
    # A wall faces the viewer level with the image; a table is seen from above, so its normal
    # leans to the image's top. An overhead or an upside-down camera is rarer, not impossible.
    return 1.0 if plane.normal[1] < 0.3 else 0.6


def _ransac(
    u: Array, v: Array, disparity: Array, tolerance: float, rng: np.random.Generator
) -> Array:
    """Return (a, b, c) of the plane 1/z = a u + b v + c with most pixels within `tolerance`."""
    design = np.stack([u, v, np.ones(len(u))])
    triples = rng.integers(0, len(u), (ITERATIONS, 3))
    matrices = np.moveaxis(design[:, triples], 0, -1)
    sound = np.abs(np.linalg.det(matrices)) > 1.0
    hypotheses = np.linalg.solve(matrices[sound], disparity[triples][sound][..., None])[..., 0]
    error = hypotheses.astype(np.float32) @ design[:, :SAMPLE].astype(np.float32)
    error -= disparity[:SAMPLE].astype(np.float32)
    near = np.abs(error, out=error) < np.float32(tolerance)
    # Counted row by row: half the time of along an axis.
    coefficients: Array = hypotheses[np.argmax([np.count_nonzero(row) for row in near])]
    for _ in range(4):
        inliers = np.abs(coefficients @ design - disparity) < tolerance
        rows = design[:, inliers]
        # Three unknowns of thousands of pixels: their normal equations are as good, and quick.
        fitted = np.linalg.lstsq(rows @ rows.T, rows @ disparity[inliers], rcond=None)[0]
        coefficients = np.asarray(fitted, np.float64)
    return coefficients


def _evaluate(coefficients: Array, u: Array, v: Array) -> Array:
    return np.asarray(coefficients[0] * u + coefficients[1] * v + coefficients[2])


def _plane_of(coefficients: Array, intrinsics: Intrinsics) -> Plane:
    """Return the plane, normal toward the camera, of 1/z = a u + b v + c."""
    a, b, c = coefficients
    # u = fx x/z + cx, so 1 = a fx x + b fy y + (a cx + b cy + c) z.
    n = np.array([a * intrinsics.fx, b * intrinsics.fy, a * intrinsics.cx + b * intrinsics.cy + c])
    length = float(np.linalg.norm(n))
    return Plane(n / length, -1.0 / length).facing(np.zeros(3))


def _large_parts(mask: Mask) -> Mask:
    # Objects in front cut a table into parts; closing joins what only their shadows part.
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    count, labels = cv2.connectedComponents(closed, connectivity=8)
    if count < 2:
        return mask
    area = np.bincount(labels.ravel())  # several times faster than with all statistics
    large = area > 0.1 * area[1:].max()
    large[0] = False  # what is no part
    return np.asarray(mask & large.take(labels))
