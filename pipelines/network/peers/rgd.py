"""RGD images, Multi-Grasp's input: red, green, and depth in the place of blue."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.array_types import Singles
from pipelines.network.imagenet import IMAGENET_MEAN, IMAGENET_STD

NEAREST, RANGE = 0.2, 1.2  # metres: depths from NEAREST to NEAREST + RANGE map to 0 to 255


def rgd_pixels(color: NDArray[np.uint8], depth: Singles) -> NDArray[np.uint8]:
    """Return the RGD image (h, w, 3) of `color` (h, w, 3) RGB and `depth` (h, w) m, 0 = missing."""
    shown = np.clip(255.0 * (depth - NEAREST) / RANGE, 0.0, 255.0)
    channel = np.where(depth > 0, np.round(shown), 0.0).astype(np.uint8)
    return np.concatenate([color[..., :2], channel[..., None]], axis=2)


def rgd_tensor(pixels: NDArray[np.uint8]) -> Tensor:
    """Return the network's input (3, h, w) of `rgd_pixels` (h, w, 3).

    It is normalised like colours: the published network starts from ImageNet weights.
    """
    values = torch.from_numpy(np.ascontiguousarray(pixels)).to(torch.float32) / 255.0
    return ((values - torch.tensor(IMAGENET_MEAN)) / torch.tensor(IMAGENET_STD)).permute(2, 0, 1)
