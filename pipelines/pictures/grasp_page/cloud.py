"""A frame's points as its page holds them: quantised depth on the grid of pixels.

A pixel needs no x and y: both follow from its place and the camera. So a point has two bytes of
depth, three bytes of colour and two bytes of region number.
"""

from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files.grasps_tables import FrameResult

FINEST_STEP = 1e-4  # metres; finer than any sensor
STEPS = 65535  # of 16 bits


@dataclass(frozen=True)
class PixelCloud:
    """The measured pixels of every `stride`-th row and column."""

    depth: NDArray[np.uint16]  # (h, w) in steps; 0 = missing
    step: float  # metres; a depth is off by at most half of it
    color: NDArray[np.uint8]  # (h, w, 3) RGB
    region: NDArray[np.uint16]  # (h, w) 0 = none, r + 1 = region r
    camera: Intrinsics  # of these pixels
    stride: int  # pixels of the frame per pixel of the cloud, each way

    @classmethod
    def of(cls, frame: Frame, result: FrameResult, max_pixels: int) -> "PixelCloud":
        """Return the cloud of a frame on at most `max_pixels` pixels."""
        stride = _stride(frame.depth.shape, max_pixels)
        thin = (slice(None, None, stride), slice(None, None, stride))
        depth = frame.depth[thin].astype(np.float64)
        step = max(FINEST_STEP, float(depth.max()) / STEPS)
        steps = np.round(depth / step)
        quantised = np.where(depth > 0, np.clip(steps, 1, STEPS), 0).astype(np.uint16)
        region = label_image(result)[thin]
        height, width = depth.shape
        whole = frame.intrinsics
        camera = Intrinsics(  # every stride-th pixel is kept, without averaging
            whole.fx / stride, whole.fy / stride, whole.cx / stride, whole.cy / stride,
            width, height,
        )  # fmt: skip
        return cls(quantised, step, np.ascontiguousarray(frame.color[thin]), region, camera, stride)

    def points(self) -> Array:
        """Return points (h, w, 3) as the page draws them, camera frame, metres; nan if missing."""
        return self.camera.backproject(self.depth * self.step)


def label_image(result: FrameResult) -> NDArray[np.uint16]:
    """Return (H, W) r + 1 on region r, 0 elsewhere; where regions overlap, the smallest region."""
    width, height = result.size
    masks = [result.regions.mask(region, width, height) for region in range(len(result.regions))]
    labels = np.zeros((height, width), np.uint16)
    for region in np.argsort([-int(mask.sum()) for mask in masks], kind="stable").tolist():
        labels[masks[region]] = region + 1
    return labels


def _stride(shape: tuple[int, ...], max_pixels: int) -> int:
    height, width = shape
    stride = max(1, int(sqrt(height * width / max_pixels)))
    while ceil(height / stride) * ceil(width / stride) > max_pixels:
        stride += 1
    return stride
