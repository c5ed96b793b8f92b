"""Random views of a detector's training frame: mirrored, zoomed, other colours, worse depth."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.array_types import Mask, Singles
from pipelines.dataset.training.detector_frames import DetectorFrame
from pipelines.geometry.pointcloud import Plane
from pipelines.network.detection.detector import detector_image
from pipelines.network.detection.mask_rcnn import COLOR_CHANNELS
from pipelines.storage.masks_rle import box_of_mask
from pipelines.tabletop.depth_channels import SmallFrame

MAX_ZOOM = 1.5
MAX_NOISE = 0.003  # metres at one metre, standard deviation of smooth depth errors; grows with z^2
NOISE_CELL = 6  # pixels over which depth errors are alike
MAX_HOLES = 12
MAX_HOLE = 0.06  # of the image's width, half-axis of an elliptic hole in the depth
MAX_EDGE_LOSS = 0.6  # share of the pixels at depth edges that lose their depth
EDGE = 0.015  # metres between neighbouring pixels that make an edge
HUE_CHANGES = 0.3  # share of views with other hues
SATURATION = (0.0, 1.5)  # factor of the distance from grey, in the share `HUE_CHANGES` of views
LIGHT = (0.6, 1.4)  # factor of each channel
GAMMA = (0.6, 1.7)  # exponent of values in [0, 1]
BLURS, BLUR = 0.4, (0.3, 1.5)  # share of views out of focus; standard deviation in pixels
MAX_COLOR_NOISE = 0.05  # standard deviation, of full brightness
STREAM_LOSS = 0.12  # share of views without colour, and of views without geometry
MIN_REGION_PIXELS = 30  # at the detector's size; smaller regions cannot be learned from


@dataclass(frozen=True)
class DetectorExample:
    """An image (C, h, w) and its regions: `boxes` (n, 4), `labels` (n,), `masks` (n, h, w)."""

    image: Tensor
    target: dict[str, Tensor]


def random_view(view: DetectorFrame, rng: np.random.Generator) -> DetectorFrame:
    """Return the frame mirrored, zoomed and with a noisier depth, each at random."""
    if rng.random() < 0.5:
        view = mirrored(view)
    view = zoomed(view, 1.0 + (MAX_ZOOM - 1.0) * rng.random() ** 2, rng)
    depth = noisy_depth(view.frame.depth, rng)
    color = random_colors(view.frame.color, rng)
    return replace(view, frame=replace(view.frame, depth=depth, color=color))


def mirrored(view: DetectorFrame) -> DetectorFrame:
    """Return the frame with left and right exchanged, the camera's x axis with it."""
    camera = view.frame.intrinsics
    frame = SmallFrame(
        np.ascontiguousarray(view.frame.color[:, ::-1]),
        np.ascontiguousarray(view.frame.depth[:, ::-1]),
        replace(camera, cx=camera.width - 1 - camera.cx),
    )
    plane = Plane(view.plane.normal * [-1.0, 1.0, 1.0], view.plane.offset)
    return DetectorFrame(frame, plane, np.ascontiguousarray(view.regions[:, ::-1]))


def zoomed(view: DetectorFrame, zoom: float, rng: np.random.Generator) -> DetectorFrame:
    """Return a window of the frame, `zoom` times enlarged, as a longer lens would show it."""
    camera = view.frame.intrinsics
    size = (camera.width, camera.height)
    # Pixel p of the window shows pixel p / zoom + corner.
    corner = rng.random(2) * (np.array(size) - 1) * (1.0 - 1.0 / zoom)
    inverse = np.array([[1.0 / zoom, 0.0, corner[0]], [0.0, 1.0 / zoom, corner[1]]])
    nearest = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    linear = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    intrinsics = replace(
        camera,
        fx=camera.fx * zoom,
        fy=camera.fy * zoom,
        cx=(camera.cx - corner[0]) * zoom,
        cy=(camera.cy - corner[1]) * zoom,
    )
    frame = SmallFrame(
        np.asarray(cv2.warpAffine(view.frame.color, inverse, size, flags=linear), np.uint8),
        np.asarray(cv2.warpAffine(view.frame.depth, inverse, size, flags=nearest), np.float32),
        intrinsics,
    )
    regions = cv2.warpAffine(view.regions, inverse, size, flags=nearest)
    return DetectorFrame(frame, view.plane, np.asarray(regions, np.uint8))


def noisy_depth(depth: Singles, rng: np.random.Generator) -> Singles:
    """Return `depth` (h, w) metres with smooth errors, holes and frayed edges."""
    height, width = depth.shape
    coarse = rng.standard_normal((height // NOISE_CELL + 2, width // NOISE_CELL + 2))
    smooth = cv2.resize(coarse.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    noisy = depth + MAX_NOISE * rng.random() * smooth * depth**2
    across, down = np.abs(np.gradient(depth))
    fray = (np.maximum(across, down) > EDGE) & (
        rng.random(depth.shape, np.float32) < MAX_EDGE_LOSS * rng.random()
    )
    holes = np.zeros(depth.shape, np.uint8)
    for _ in range(rng.integers(MAX_HOLES)):
        center = (int(rng.integers(width)), int(rng.integers(height)))
        axes = (rng.random(2) * MAX_HOLE * width).astype(int) + 1
        angle = float(rng.uniform(0.0, 180.0))
        cv2.ellipse(holes, center, (int(axes[0]), int(axes[1])), angle, 0.0, 360.0, 1, -1)
    lost = fray | (holes > 0) | (depth <= 0)
    return np.where(lost, 0.0, np.maximum(noisy, 0.0)).astype(np.float32)


def random_colors(color: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return `color` (h, w, 3) under another light, seen by another camera, with other hues."""
    values: Singles = color.astype(np.float32) / 255.0
    if rng.random() < HUE_CHANGES:
        values = values[..., rng.permutation(3)]
    if rng.random() < HUE_CHANGES:
        grey = values.mean(axis=-1, keepdims=True)
        values = grey + rng.uniform(*SATURATION) * (values - grey)
    light = rng.uniform(*LIGHT, 3).astype(np.float32)
    values = np.asarray(np.clip(values * light, 0.0, 1.0) ** rng.uniform(*GAMMA), np.float32)
    if rng.random() < BLURS:
        values = np.asarray(cv2.GaussianBlur(values, (0, 0), rng.uniform(*BLUR)), np.float32)
    noise = MAX_COLOR_NOISE * rng.random() * rng.standard_normal(values.shape, np.float32)
    return np.asarray(np.clip(255.0 * (values + noise), 0.0, 255.0), np.uint8)


def with_lost_stream(image: Tensor, kind: str, rng: np.random.Generator) -> Tensor:
    """Return an image (C, h, w) of `detector_image` that lacks colour or geometry, at random.

    A detector of `both` thus learns to work with either; other kinds stay unchanged.
    """
    if kind != "both" or (which := rng.random()) > 2.0 * STREAM_LOSS:
        return image
    image = image.clone()
    if which < STREAM_LOSS:
        image[:COLOR_CHANNELS] = 0.0
    else:
        image[COLOR_CHANNELS:] = 0.0
        image[-1] = 1.0  # all depth is missing
    return image


def as_example(view: DetectorFrame, kind: str) -> DetectorExample:
    """Return the input and the target of the detector for a frame."""
    image = detector_image(view.frame, view.plane, kind)
    masks = masks_of(view.regions)
    boxes = np.array([box_of_mask(mask) for mask in masks], np.float32).reshape(-1, 4)
    target = {
        "boxes": torch.from_numpy(boxes),
        "labels": torch.ones(len(masks), dtype=torch.int64),
        "masks": torch.from_numpy(masks.astype(np.uint8)),
    }
    return DetectorExample(image, target)


def random_example(view: DetectorFrame, kind: str, rng: np.random.Generator) -> DetectorExample:
    """Return a random view of a frame as a training example of a detector of `kind`."""
    example = as_example(random_view(view, rng), kind)
    return replace(example, image=with_lost_stream(example.image, kind, rng))


def masks_of(regions: NDArray[np.uint8]) -> Mask:
    """Return the masks (n, h, w) of the regions large enough to be learned from."""
    sizes = np.bincount(regions.ravel(), minlength=1)
    numbers = [n for n in range(1, len(sizes)) if sizes[n] >= MIN_REGION_PIXELS]
    return np.array([regions == n for n in numbers], bool).reshape(-1, *regions.shape)
