"""Pixels below a plane that join it without a step: the sides of an object under its lid."""

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.geometry.numerics.compiled import compiled


@compiled
def pixels_of_sides(
    z: Array, near: Mask, inliers: Mask, over: Array, tolerance: float, step: float
) -> int:
    """Return the number of pixels that lie below a plane and join it from pixel to pixel.

    Args:
        z: (H, W) depth in metres, nan where missing.
        near: (H, W) pixels to search.
        inliers: (H, W) pixels of the plane.
        over: (H, W) inverse depth minus that of the plane.
        tolerance: inverse depth from which a pixel counts as below.
        step: largest difference of neighbours on one surface, as a share of their depth.
    """
    height, width = z.shape
    seen = inliers.copy()
    waiting = np.empty(height * width, np.int64)
    top, count = 0, 0
    for row in range(height):
        for column in range(width):
            if inliers[row, column]:
                waiting[top] = row * width + column
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
