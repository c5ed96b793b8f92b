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
        error = self.noise * np.minimum(z, 10.0) * offset
        return np.asarray(np.maximum(config.min_height, NOISE_FACTOR * error))


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
    warp = _smooth(np.where(inliers, residual, 0.0), inliers)
    noise = 1.4826 * float(np.median(np.abs(_thinned(residual - warp, inliers))))
    # Inverse depth less the sensor's warp of the table: the same pixels, the table made flat.
    height = (xyz @ support.plane.normal) / (1.0 - warp * z) + support.plane.offset
    top = Tabletop(support.plane, near, near, noise)
    threshold = top.threshold(z, config)
    above = near & (height > threshold) & (height < config.max_height)
    above = cv2.medianBlur(above.astype(np.uint8), 3) > 0
    above &= near
    extent = _thinned(xyz, _large_parts(inliers))
    table = Footprint.around(extent, support.plane, config.support_margin)
    above[above] = table.contains(xyz[above])
    return replace(top, foreground=above, clear=above & (height > CLEARLY * threshold))


def _thinned(values: Array, mask: Mask) -> Array:
    """Return (n, ...) `values` (H, W, ...) at some pixels of `mask` (H, W), evenly spread."""
    some = values[::THIN, ::THIN][mask[::THIN, ::THIN]]
    return some if len(some) else values[mask]


def _smooth(values: Array, mask: Mask) -> Array:
    """Return (H, W) the mean of `values` over the pixels of `mask` in a wide window, else 0."""
    size = (WARP_WINDOW, WARP_WINDOW)
    weight = cv2.boxFilter(mask.astype(np.float64), -1, size)
    total = cv2.boxFilter(np.where(mask, values, 0.0), -1, size)
    return np.where(weight > 0.1, total / np.maximum(weight, 0.1), 0.0)


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
        cell = np.floor((points @ self.axes - self.low) / CELL).astype(int)
        inside = ((cell >= 0) & (cell < self.cells.shape[::-1])).all(axis=1)
        cell[~inside] = 0
        return np.asarray(inside & (self.cells[cell[:, 1], cell[:, 0]] > 0))


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
        v, u = np.arange(z.shape[0])[:, None], np.arange(z.shape[1])
        return np.asarray(1.0 / z - _evaluate(self.coefficients, u, v))


def _find_support(
    xyz: Array, near: Mask, intrinsics: Intrinsics, config: RegionConfig, rng: np.random.Generator
) -> _Support | None:
    """Return the best of `MAX_PLANES` candidates; None where none is big enough.

    Candidates are drawn in turn from what earlier ones left. The best has most pixels, near ones
    counting more; what is seen beneath a plane's own extent speaks against it, because things
    stand on a table and nothing is seen through it.
    """
    v, u = np.nonzero(near)
    if len(u) < MIN_PIXELS:
        return None
    take = rng.choice(len(u), min(len(u), 5 * SAMPLE), replace=False)
    u, v = u[take], v[take]
    points = xyz[v, u]
    disparity = 1.0 / points[:, 2]
    weight = disparity**2 / (disparity**2).sum()
    best, best_value, left = None, config.min_plane_share, np.ones(len(u), bool)
    for _ in range(MAX_PLANES):
        if left.sum() < MIN_PIXELS:
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
    """Return which of `points` (n, 3) that are `behind` the plane are seen through its extent."""
    along = points[behind] @ plane.normal
    crossing = points[behind] * (-plane.offset / np.where(along < 0, along, -1e-9))[:, None]
    result = behind.copy()
    extent = points[inliers][:SAMPLE]
    result[behind] = Footprint.around(extent, plane, 0.0).contains(crossing)
    return result


def _facing_weight(plane: Plane) -> float:
    # A wall faces the viewer level with the image; a table is seen from above, so its normal
    # leans to the image's top. An overhead or an upside-down camera is rarer, not impossible.
    return 1.0 if plane.normal[1] < 0.3 else 0.6


def _ransac(
    u: NDArray[np.int64],
    v: NDArray[np.int64],
    disparity: Array,
    tolerance: float,
    rng: np.random.Generator,
) -> Array:
    """Return (a, b, c) of the plane 1/z = a u + b v + c with most pixels within `tolerance`."""
    design = np.stack([u, v, np.ones(len(u))], 1).astype(np.float64)
    subset = slice(None) if len(u) <= SAMPLE else slice(SAMPLE)
    triples = rng.integers(0, len(design), (ITERATIONS, 3))
    matrices = design[triples]
    sound = np.abs(np.linalg.det(matrices)) > 1.0
    hypotheses = np.linalg.solve(matrices[sound], disparity[triples][sound][..., None])[..., 0]
    error = hypotheses.astype(np.float32) @ design[subset].T.astype(np.float32)
    error -= disparity[subset].astype(np.float32)
    near = np.abs(error, out=error) < np.float32(tolerance)
    coefficients: Array = hypotheses[np.count_nonzero(near, axis=1).argmax()]
    for _ in range(4):
        inliers = np.abs(design @ coefficients - disparity) < tolerance
        rows = design[inliers]
        # Three unknowns of thousands of pixels: their normal equations are as good, and quick.
        fitted = np.linalg.lstsq(rows.T @ rows, disparity[inliers] @ rows, rcond=None)[0]
        coefficients = np.asarray(fitted, np.float64)
    return coefficients


def _evaluate(coefficients: Array, u: NDArray[np.int64], v: NDArray[np.int64]) -> Array:
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
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    if count < 2:
        return mask
    large = stats[:, cv2.CC_STAT_AREA] > 0.1 * stats[1:, cv2.CC_STAT_AREA].max()
    large[0] = False  # what is no part
    return np.asarray(mask & large[labels])
