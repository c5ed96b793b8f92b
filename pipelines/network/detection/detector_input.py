"""Input of the detector: geometry from depth, colour, or both (D. 19)."""

import numpy as np
import torch
from torch import Tensor

from pipelines.array_types import Singles
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.depth_channels import SmallFrame, depth_channels

COLOR_MEAN = (0.485, 0.456, 0.406)  # ImageNet's, which COCO weights were trained with
COLOR_STD = (0.229, 0.224, 0.225)


def detector_image(frame: SmallFrame, plane: Plane, kind: str) -> Tensor:
    """Return (C, h, w) float32: colour, geometry, or colour and then geometry.

    `kind`: geometry, color or both. `plane`: the support plane, camera frame.
    """
    parts: list[Singles] = []
    if kind in {"color", "both"}:
        normalised = (frame.color / 255.0 - np.array(COLOR_MEAN)) / np.array(COLOR_STD)
        parts.append(np.ascontiguousarray(np.moveaxis(normalised, -1, 0), np.float32))
    if kind in {"geometry", "both"}:
        parts.append(depth_channels(frame.depth, frame.intrinsics, plane))
    return torch.from_numpy(parts[0] if len(parts) == 1 else np.concatenate(parts))
