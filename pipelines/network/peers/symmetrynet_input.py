"""Input of SymmetryNet: a square of the colour image about a region, and pixels in it."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.array_types import Indices, Mask
from pipelines.network.imagenet import IMAGENET_MEAN, IMAGENET_STD

CROP_SIDE = 120  # pixels; a multiple of 40 as in the original, but the same for all regions
MARGIN = 0.1  # margin on each side, as a share of the region's longer side


@dataclass(frozen=True)
class RegionCrop:
    """A region's part of the image.

    Attributes:
        image: (S, S, 3) RGB, 0 beyond the frame.
        mask: (S, S) pixels of the region.
        pixels: (n, 2) columns and rows of the region's points.
    """

    image: NDArray[np.uint8]
    mask: Mask
    pixels: NDArray[np.uint8]


def region_crop(color: NDArray[np.uint8], mask: Mask, pixels: Indices) -> RegionCrop:
    """Return the square about the region `mask` (H, W) of `color` (H, W, 3).

    `pixels`: (n, 2) columns and rows, in the frame, of the region's points.
    """
    first, last = pixels.min(axis=0), pixels.max(axis=0)
    side = int(np.ceil((last - first + 1).max() * (1.0 + 2.0 * MARGIN)))
    corner = (first + last + 1 - side) // 2
    left, top = np.maximum(-corner, 0).tolist()
    right, bottom = np.maximum(corner + side - mask.shape[::-1], 0).tolist()
    x, y = np.maximum(corner, 0).tolist()
    parts = []
    for image, method in (
        (color, cv2.INTER_AREA if side > CROP_SIDE else cv2.INTER_LINEAR),
        (mask.astype(np.uint8), cv2.INTER_NEAREST),
    ):
        whole = cv2.copyMakeBorder(image, top, bottom, left, right, cv2.BORDER_CONSTANT)
        part = np.ascontiguousarray(whole[y : y + side, x : x + side])
        parts.append(cv2.resize(part, (CROP_SIDE, CROP_SIDE), interpolation=method))
    at = (pixels - corner + 0.5) * (CROP_SIDE / side)
    at = np.clip(at, 0, CROP_SIDE - 1).astype(np.uint8)
    return RegionCrop(np.asarray(parts[0], np.uint8), np.asarray(parts[1]) > 0, at)


def normalised_colors(
    image: Tensor,  # (B, S, S, 3) uint8
    jitter: Tensor | None = None,  # (B, 3, 4)
) -> Tensor:
    """Return colours (B, 3, S, S) normalised by ImageNet's mean and deviation after `jitter`.

    `jitter`: for each image a matrix and an offset that change its colours, 0 to 1.
    """
    colors = image.permute(0, 3, 1, 2).float() / 255.0
    if jitter is not None:
        changed = torch.einsum("bij,bjhw->bihw", jitter[..., :3], colors)
        colors = (changed + jitter[..., 3, None, None]).clamp(0.0, 1.0)
    mean, std = (colors.new_tensor(each)[:, None, None] for each in (IMAGENET_MEAN, IMAGENET_STD))
    return (colors - mean) / std
