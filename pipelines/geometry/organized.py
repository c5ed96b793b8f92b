"""Organised clouds: normals of a depth image's pixels from planes in inverse depth."""

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

Powers = tuple[tuple[int, int], ...]

FEWEST = 6  # pixels that a plane is fitted to
VALUES: Powers = ((0, 0), (1, 0), (0, 1))  # powers of column and row that make moments
SQUARES: Powers = ((2, 0), (0, 2), (1, 1))


def smooth_normals(xyz: Array, mask: Mask, radius: int) -> Array:
    """Return (H, W, 3) unit normals toward the camera from planes fitted in inverse depth.

    The plane at a pixel is fitted to the pixels of `mask` in the square of `radius` about it;
    nan outside `mask` and where fewer than six pixels, or only those of one line, are there.
    `xyz`: (H, W, 3) metres, of a pinhole camera or a part of its image; nan where missing.
    """
    known = mask & np.isfinite(xyz[..., 2])
    normals = np.full(xyz.shape, np.nan)
    for axis, values in enumerate(normals_at(xyz, known, radius)):
        normals[..., axis][known] = values
    return normals


def normals_at(xyz: Array, known: Mask, radius: int) -> list[Array]:
    """Return x, y and z (n,) of the normals of `smooth_normals` at the pixels of `known`.

    These (H, W) come row by row; their depth must be finite.
    """
    # An axis at a time, each in one piece: a fourth of the time of rows of three.
    x, y, z = (xyz[..., axis][known] for axis in range(3))
    if not len(z):
        return [x, y, z]
    x /= z
    y /= z
    by_column, by_row, middle = _fitted(1.0 / z, known, radius)
    # d = a x + b y + c with x, y on the image plane at depth 1: the normal is (a, b, c).
    with np.errstate(divide="ignore", invalid="ignore"):
        a = by_column * (_span(known, axis=0) / np.ptp(x))
        b = by_row * (_span(known, axis=1) / np.ptp(y))
        c = middle - a * x - b * y
        length = -np.sqrt(a * a + b * b + c * c)
    return [a / length, b / length, c / length]


def _span(known: Mask, axis: int) -> int:
    """Return how far in pixels the outermost of `known` (H, W) are from each other."""
    places = np.flatnonzero(known.any(axis=axis))
    return int(places[-1] - places[0])


def _fitted(d: Array, known: Mask, radius: int) -> list[Array]:
    """Return (n,) three times: the fitted planes' slope by column and by row, and value there.

    `d`: (n,) inverse depth at the pixels of `known`. All are nan where there is no plane.
    """
    inverse = np.zeros(known.shape)
    inverse[known] = d
    s, us, vs = _moments(inverse, known, radius, VALUES)
    # In a whole window the places beside the middle are without correlation, their mean 0.
    size = 2 * radius + 1
    spread = size**2 * radius * (radius + 1) / 3.0
    found = [us / spread, vs / spread, s / size**2]
    weight = known.astype(np.uint8)
    window = np.ones((size, size), np.uint8)
    whole = cv2.erode(weight, window, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    part = ~whole[known]
    counts = _moments(weight, known & ~whole, radius, VALUES + SQUARES)
    in_part = _fitted_in_part(counts, [each[part] for each in (s, us, vs)])
    for everywhere, values in zip(found, in_part, strict=True):
        everywhere[part] = values
    return found


def _moments(
    image: Array | NDArray[np.uint8], where: Mask, radius: int, powers: Powers
) -> list[Array]:
    """Return (n,) at `where` the sums of `image` over the windows, a list by pairs of `powers`.

    Each is weighted by these powers of the columns and the rows from a window's middle.
    """
    ramp = np.arange(-radius, radius + 1.0)
    # Sums of bytes are small whole numbers: single precision has room for them.
    depth = cv2.CV_32F if image.dtype == np.uint8 else cv2.CV_64F
    found = []
    for column, row in powers:
        kernels = ramp**column, ramp**row
        sums = cv2.sepFilter2D(image, depth, *kernels, borderType=cv2.BORDER_CONSTANT)
        found.append(np.asarray(sums[where], np.float64))
    return found


def _fitted_in_part(counts: list[Array], values: list[Array]) -> list[Array]:
    """Return what `_fitted` does of the moments of windows that need not be whole."""
    n, u, v, uu, vv, uv = counts
    s, us, vs = values
    uu, vv, uv = n * uu - u * u, n * vv - v * v, n * uv - u * v
    us, vs = n * us - u * s, n * vs - v * s
    determinant = uu * vv - uv * uv  # of whole numbers: exactly 0 where all are on one line
    determinant[(determinant == 0.0) | (n < FEWEST)] = np.nan
    by_column, by_row = (vv * us - uv * vs) / determinant, (uu * vs - uv * us) / determinant
    return [by_column, by_row, (s - by_column * u - by_row * v) / n]
