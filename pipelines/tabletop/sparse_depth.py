"""Filling of sparse depth, as from registration to a larger colour image.

Later filters compare a pixel with its neighbours and would reject every pixel as stray if most
neighbours were missing. So the holes between measured pixels are filled first.
"""

import cv2
import numpy as np

from pipelines.array_types import Mask, Singles

HOLE_WINDOW = 5  # pixels: closes holes between measured pixels, but not shadows
DENSE = 0.7  # measured share of the closed surface from which depth is unchanged


def measured_share(depth: Singles) -> float:
    """Return the measured share of the surface in `depth` (H, W), holes closed; 1 without depth."""
    measured = depth > 0.0
    return _share(measured, _closed(measured))


def filled(depth: Singles) -> Singles:
    """Return `depth` (H, W) metres, 0 where missing, with small holes set to the nearest pixel.

    Dense depth is returned as is; holes wider than `HOLE_WINDOW` are never filled.
    """
    measured = depth > 0.0
    surface = _closed(measured)
    if _share(measured, surface) >= DENSE:
        return depth
    return np.where(surface & ~measured, nearest_measured(depth), depth)


def nearest_measured(depth: Singles, mask_size: int = 5) -> Singles:
    """Return `depth` (H, W) with each 0 set to the depth of the nearest pixel over 0, if any.

    `mask_size`: mask of OpenCV's distance transform, 3 or 5; 5 is more exact.
    """
    measured = depth > 0
    if not measured.any():
        return depth
    _, nearest = cv2.distanceTransformWithLabels(
        (~measured).astype(np.uint8), cv2.DIST_L2, mask_size, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.zeros(int(nearest.max()) + 1, depth.dtype)
    of_label[nearest[measured]] = depth[measured]
    found: Singles = of_label[nearest]
    return found


def _share(measured: Mask, surface: Mask) -> float:
    count = np.count_nonzero(surface)
    return np.count_nonzero(measured) / count if count else 1.0


def _closed(measured: Mask) -> Mask:
    kernel = np.ones((HOLE_WINDOW, HOLE_WINDOW), np.uint8)
    closed = cv2.morphologyEx(measured.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    return np.asarray(closed, np.uint8) > 0
