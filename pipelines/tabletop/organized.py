"""Normals of organised clouds, from planes fitted in inverse depth."""

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Floats, Mask
from pipelines.geometry.numerics.compiled import compiled

Bytes = NDArray[np.uint8]

Pair = tuple[float, float]
Three = tuple[float, float, float]

FEWEST = 6  # pixels to which a plane is fitted


def smooth_normals(xyz: Array, mask: Mask, radius: int) -> Array:
    """Return unit normals (H, W, 3) toward the camera, from planes fitted in inverse depth.

    The plane at a pixel is fitted to the pixels of `mask` within `radius` along rows and columns.
    nan outside `mask`, and where the square holds fewer than six pixels or only one line of pixels.
    `xyz`: (H, W, 3) metres, of a pinhole camera or a part of its image; nan where missing.
    """
    whole = np.ascontiguousarray(xyz), np.ascontiguousarray(mask)
    return _normals(*_inverse(*whole), radius)


def image_normals(depth: Floats, x: Array, y: Array, radius: int) -> Array:
    """Return the `smooth_normals` of `depth` (H, W), metres, measured everywhere.

    `x`, `y`: coordinates (W,) of the columns and (H,) of the rows at depth 1.
    """
    with np.errstate(divide="ignore"):  # depth of 0 gives nan
        inverse = 1.0 / depth.astype(np.float64)
    return _normals(inverse, np.ones(depth.shape, np.uint8), x, y, radius)


@compiled
def _inverse(xyz: Array, mask: Mask) -> tuple[Array, Bytes, Array, Array]:
    """Return the arguments `inverse`, `known`, `x` and `y` of `_normals`."""
    height, width = mask.shape
    inverse, known = np.zeros((height, width)), np.zeros((height, width), np.uint8)
    left, right, top, bottom = width, -1, height, -1  # outermost measured columns and rows
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
    # Two columns and two rows are needed for a plane, and for the spacing of the pixels.
    x = x0 + (np.arange(width) - left) * ((x1 - x0) / max(right - left, 1))
    y = y0 + (np.arange(height) - top) * ((y1 - y0) / max(bottom - top, 1))
    return inverse, known, x, y


@compiled
def _normals(inverse: Array, known: Bytes, x: Array, y: Array, radius: int) -> Array:
    """Return the normals (H, W, 3) at the `known` (H, W) pixels, nan elsewhere.

    `inverse`: (H, W) 1 / depth at known pixels, 0 elsewhere. `x`, `y`: as in `image_normals`.
    """
    height, width = known.shape
    normals = np.empty((height, width, 3))
    if height < 2 or width < 2:
        normals[:] = np.nan
        return normals
    slopes = (width - 1) / (x[-1] - x[0]), (height - 1) / (y[-1] - y[0])
    down = np.zeros((5, width + 2 * radius))
    sums, fitted = np.zeros((4, width)), np.zeros((3, width))
    size = (2 * radius + 1) ** 2
    for row in range(height):
        _sum_down(inverse, known, row, radius, down)
        _sum_across(down, radius, sums)
        _fit_whole(sums, slopes, x, y[row], radius, fitted)
        for column in range(width):
            normal = np.nan, np.nan, np.nan
            if known[row, column] and sums[0, column] == size:
                normal = fitted[0, column], fitted[1, column], fitted[2, column]
            elif known[row, column]:
                by_column, by_row, middle = _fitted_in_part(down, sums, column, radius)
                place = x[column], y[row]
                normal = _unit(by_column * slopes[0], by_row * slopes[1], middle, place)
            normals[row, column, 0], normals[row, column, 1], normals[row, column, 2] = normal
    return normals


@compiled
def _sum_down(inverse: Array, known: Bytes, row: int, radius: int, down: Array) -> None:
    """Set `down` (5, W + 2 radius) to sums over the columns of the windows around one row.

    With v the row from the window's middle: sums of 1, v, v^2 over known pixels, and of d, v d over
    inverse depths d; 0 in the margins.
    """
    height, width = known.shape
    down[:] = 0.0
    inner = slice(radius, radius + width)
    n, v, vv, s, vs = down[0, inner], down[1, inner], down[2, inner], down[3, inner], down[4, inner]
    for k in range(-min(radius, row), min(radius, height - 1 - row) + 1):
        ones, values, step = known[row + k], inverse[row + k], np.float64(k)
        for column in range(width):
            one, value = np.float64(ones[column]), values[column]
            n[column] += one
            v[column] += step * one
            vv[column] += step * step * one
            s[column] += value
            vs[column] += step * value


@compiled
def _sum_across(down: Array, radius: int, sums: Array) -> None:
    """Set `sums` (4, W) to sums over windows: known pixels, and d, u d, v d of inverse depths d.

    `down`: sums of `_sum_down`.
    """
    width = sums.shape[1]
    sums[:] = 0.0
    n, s, us, vs = sums[0], sums[1], sums[2], sums[3]
    for k in range(2 * radius + 1):
        step, part = np.float64(k - radius), slice(k, k + width)
        known, values, rising = down[0, part], down[3, part], down[4, part]
        for column in range(width):
            n[column] += known[column]
            s[column] += values[column]
            us[column] += step * values[column]
            vs[column] += rising[column]


@compiled
def _fit_whole(sums: Array, slopes: Pair, x: Array, y: float, radius: int, fitted: Array) -> None:
    """Set `fitted` (3, W) to the normals of planes fitted to windows without missing pixels.

    `sums`: sums of `_sum_across`. `slopes`: factors from slopes per pixel to slopes by x and y.
    """
    size = (2 * radius + 1) ** 2
    # In such a window u and v are uncorrelated with mean 0, so each slope has its own quotient.
    spread = size * radius * (radius + 1) / 3.0
    across, down, mean = slopes[0] / spread, slopes[1] / spread, 1.0 / size
    s, us, vs = sums[1], sums[2], sums[3]
    first, second, third = fitted[0], fitted[1], fitted[2]
    for n in range(len(x)):
        normal = _unit(us[n] * across, vs[n] * down, s[n] * mean, (x[n], y))
        first[n], second[n], third[n] = normal


@compiled
def _unit(a: float, b: float, middle: float, place: Pair) -> Three:
    """Return the normal of the plane with inverse depth `middle` at `place` (x, y)."""
    # d = a x + b y + c with x, y on the image plane at depth 1: the normal is (a, b, c).
    c = middle - a * place[0] - b * place[1]
    scale = -1.0 / np.sqrt(a * a + b * b + c * c)
    return a * scale, b * scale, c * scale


@compiled
def _fitted_in_part(down: Array, sums: Array, at: int, radius: int) -> Three:
    """Return slope by column, slope by row and value of the plane in a window with missing pixels.

    nan if no plane is determined. `at`: column of the window; `down`, `sums`: sums of its row.
    """
    n, s, us, vs = sums[0, at], sums[1, at], sums[2, at], sums[3, at]
    u, v, squares_u, squares_v, products = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(2 * radius + 1):
        step = np.float64(k - radius)
        u += step * down[0, at + k]
        v += down[1, at + k]
        squares_u += step * step * down[0, at + k]
        squares_v += down[2, at + k]
        products += step * down[1, at + k]
    uu, vv, uv = n * squares_u - u * u, n * squares_v - v * v, n * products - u * v
    determinant = uu * vv - uv * uv  # integers, so exactly 0 for pixels on one line
    if n < FEWEST or determinant == 0.0:
        return np.nan, np.nan, np.nan
    us, vs = n * us - u * s, n * vs - v * s
    by_column, by_row = (vv * us - uv * vs) / determinant, (uu * vs - uv * us) / determinant
    return by_column, by_row, (s - by_column * u - by_row * v) / n
