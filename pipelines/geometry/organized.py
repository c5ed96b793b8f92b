"""Organised clouds: normals of a depth image's pixels from planes in inverse depth."""

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.compiled import compiled

Array = NDArray[np.float64]
Floats = NDArray[np.floating]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

Powers = tuple[tuple[int, int], ...]
Three = tuple[float, float, float]

FEWEST = 6  # pixels that a plane is fitted to
VALUES: Powers = ((0, 0), (1, 0), (0, 1))  # powers of column and row that make moments
SQUARES: Powers = ((2, 0), (0, 2), (1, 1))


def smooth_normals(xyz: Array, mask: Mask, radius: int) -> Array:
    """Return (H, W, 3) unit normals toward the camera from planes fitted in inverse depth.

    The plane at a pixel is fitted to the pixels of `mask` in the square of `radius` about it;
    nan outside `mask` and where fewer than six pixels, or only those of one line, are there.
    `xyz`: (H, W, 3) metres, of a pinhole camera or a part of its image; nan where missing.
    """
    whole = np.ascontiguousarray(xyz), np.ascontiguousarray(mask)
    return _normals(*_inverse(*whole), radius)


def image_normals(depth: Floats, x: Array, y: Array, radius: int) -> Array:
    """Return the `smooth_normals` of `depth` (H, W), metres, known everywhere.

    `x`, `y`: (W,), (H,) where the columns and rows lie on the image plane at depth 1.
    """
    with np.errstate(divide="ignore"):  # without any depth there are no normals
        inverse = 1.0 / depth.astype(np.float64)
    return _normals(inverse, np.ones(depth.shape, np.uint8), x, y, radius)


def _normals(inverse: Array, known: Bytes, x: Array, y: Array, radius: int) -> Array:
    """Return (H, W, 3) the normals at pixels that are `known` (H, W), nan elsewhere.

    `inverse`: (H, W) 1 / depth there, 0 elsewhere. `x`, `y`: as in `image_normals`.
    """
    sums = _moments(inverse, cv2.CV_64F, radius, VALUES)
    # Sums of bytes are small whole numbers: single precision has room for them.
    counts = _moments(known, cv2.CV_32F, radius, VALUES + SQUARES)
    return _fitted(sums, counts, known, x, y, radius)


def _moments(image: Array | Bytes, depth: int, radius: int, powers: Powers) -> tuple[Floats, ...]:
    """Return (H, W) images of sums of `image` over the windows, a list by pairs of `powers`.

    Each is weighted by these powers of the columns and the rows from a window's middle.
    """
    ramp = np.arange(-radius, radius + 1.0)
    return tuple(
        np.asarray(
            cv2.sepFilter2D(image, depth, ramp**column, ramp**row, borderType=cv2.BORDER_CONSTANT)
        )
        for column, row in powers
    )


@compiled
def _inverse(xyz: Array, mask: Mask) -> tuple[Array, Bytes, Array, Array]:
    """Return what `_normals` takes of the pixels of `mask` (H, W) that were measured."""
    height, width = mask.shape
    inverse, known = np.zeros((height, width)), np.zeros((height, width), np.uint8)
    left, right, top, bottom = width, -1, height, -1  # outermost columns and rows, where they lie
    x0, x1, y0, y1 = 0.0, 0.0, 0.0, 0.0
    for row in range(height):
        for column in range(width):
            z = xyz[row, column, 2]
            if not (mask[row, column] and np.isfinite(z)):
                continue
            inverse[row, column] = 1.0 / z
            known[row, column] = 1
            if column < left:
                left, x0 = column, xyz[row, column, 0] / z
            if column > right:
                right, x1 = column, xyz[row, column, 0] / z
            if row < top:
                top, y0 = row, xyz[row, column, 1] / z
            bottom, y1 = row, xyz[row, column, 1] / z
    # Without two columns and two rows there is no plane, and no telling how far they are apart.
    x = x0 + (np.arange(width) - left) * ((x1 - x0) / max(right - left, 1))
    y = y0 + (np.arange(height) - top) * ((y1 - y0) / max(bottom - top, 1))
    return inverse, known, x, y


@compiled
def _fitted(
    sums: tuple[Floats, ...],
    counts: tuple[Floats, ...],
    known: Bytes,
    x: Array,
    y: Array,
    radius: int,
) -> Array:
    """Return (H, W, 3) the normals of planes fitted to windows with these moments."""
    height, width = known.shape
    normals = np.full((height, width, 3), np.nan)
    if height < 2 or width < 2:
        return normals
    size = (2 * radius + 1) ** 2
    # In a whole window the places beside the middle are without correlation, their mean 0.
    spread = size * radius * (radius + 1) / 3.0
    across, down = (width - 1) / (x[-1] - x[0]), (height - 1) / (y[-1] - y[0])
    for row in range(height):
        for column in range(width):
            if not known[row, column]:
                continue
            at = row, column
            n, s, us, vs = np.float64(counts[0][at]), sums[0][at], sums[1][at], sums[2][at]
            if n == size:
                by_column, by_row, middle = us / spread, vs / spread, s / size
            else:
                places = n, np.float64(counts[1][at]), np.float64(counts[2][at])
                squares = counts[3][at], counts[4][at], counts[5][at]
                by_column, by_row, middle = _fitted_in_part(places, squares, (s, us, vs))
            # d = a x + b y + c with x, y on the image plane at depth 1: the normal is (a, b, c).
            a, b = by_column * across, by_row * down
            c = middle - a * x[column] - b * y[row]
            scale = -1.0 / np.sqrt(a * a + b * b + c * c)
            normals[row, column, 0] = a * scale
            normals[row, column, 1] = b * scale
            normals[row, column, 2] = c * scale
    return normals


@compiled
def _fitted_in_part(places: Three, squares: Three, values: Three) -> Three:
    """Return a plane's slope by column and by row and its value, of a window that is not whole.

    nan where there is no plane. Moments: of the pixels' `places` by `VALUES` and by `SQUARES`,
    of their `values` by `VALUES`.
    """
    n, u, v = places
    s, us, vs = values
    uu, vv, uv = n * squares[0] - u * u, n * squares[1] - v * v, n * squares[2] - u * v
    determinant = uu * vv - uv * uv  # of whole numbers: exactly 0 where all are on one line
    if n < FEWEST or determinant == 0.0:
        return np.nan, np.nan, np.nan
    us, vs = n * us - u * s, n * vs - v * s
    by_column, by_row = (vv * us - uv * vs) / determinant, (uu * vs - uv * us) / determinant
    return by_column, by_row, (s - by_column * u - by_row * v) / n
