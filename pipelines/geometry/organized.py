"""Organised clouds: normals of a depth image's pixels from planes in inverse depth."""

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def smooth_normals(xyz: Array, mask: Mask, radius: int) -> Array:
    """Return (H, W, 3) unit normals toward the camera from planes fitted in inverse depth.

    The plane at a pixel is fitted to the pixels of `mask` in the square of `radius` about it;
    nan outside `mask` and where fewer than six pixels are there.
    """
    known = mask & np.isfinite(xyz[..., 2])
    weight = known.astype(np.float64)
    x, y, z = (np.where(known, xyz[..., axis], 1.0) for axis in range(3))
    x, y, d = x / z, y / z, 1.0 / z

    def total(values: Array) -> Array:
        size = (2 * radius + 1, 2 * radius + 1)
        filtered = cv2.boxFilter(
            values * weight, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT
        )
        return np.asarray(filtered, np.float64)

    count = np.maximum(total(np.ones_like(weight)), 1e-9)
    mx, my, md = total(x) / count, total(y) / count, total(d) / count
    xx, yy, xy = (total(p * q) / count for p, q in ((x, x), (y, y), (x, y)))
    xx, yy, xy = xx - mx * mx, yy - my * my, xy - mx * my
    xd, yd = total(x * d) / count - mx * md, total(y * d) / count - my * md
    determinant = xx * yy - xy * xy
    # d = a x + b y + c with x, y on the image plane at depth 1: the normal is (a, b, c).
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (yy * xd - xy * yd) / determinant
        b = (xx * yd - xy * xd) / determinant
        n = -np.stack([a, b, md - a * mx - b * my], -1)
        n = n / np.linalg.norm(n, axis=-1, keepdims=True)
    n[(weight == 0) | (count < 6) | (determinant < 1e-14)] = np.nan
    return np.asarray(n)
