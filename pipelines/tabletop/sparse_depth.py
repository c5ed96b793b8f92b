"""Depth with a hole beside almost every pixel, as registering it to a larger picture leaves it.

Neighbours tell a stray pixel from a surface, and noise from an edge: where most of them are
missing, everything would count as stray. So what lies between measured pixels is filled first.
"""

import cv2
import numpy as np

from pipelines.array_types import Mask, Singles

GAP = 5  # pixels: the window that closes holes between measured pixels, not shadows
DENSE = 0.7  # share of the closed surface that is measured, from which depth is left as it is


def measured_share(depth: Singles) -> float:
    """Return which share of the surface that `depth` (H, W) shows is measured; 1 without any."""
    measured = depth > 0.0
    return _share(measured, _closed(measured))


def filled(depth: Singles) -> Singles:
    """Return `depth` (H, W) metres, 0 where missing, with holes as far as the nearest measured one.

    The same array where it is dense enough; holes wider than `GAP` are never filled.
    """
    measured = depth > 0.0
    surface = _closed(measured)
    if _share(measured, surface) >= DENSE:
        return depth
    _, nearest = cv2.distanceTransformWithLabels(
        (~measured).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.zeros(int(nearest.max()) + 1, depth.dtype)
    of_label[nearest[measured]] = depth[measured]
    return np.where(surface & ~measured, of_label[nearest], depth)


def _share(measured: Mask, surface: Mask) -> float:
    count = np.count_nonzero(surface)
    return np.count_nonzero(measured) / count if count else 1.0


def _closed(measured: Mask) -> Mask:
    kernel = np.ones((GAP, GAP), np.uint8)
    closed = cv2.morphologyEx(measured.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    return np.asarray(closed, np.uint8) > 0
