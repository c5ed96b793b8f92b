"""Training regions of SymmetryNet: crops of colour, points, true symmetries."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.array_types import Mask, Singles
from pipelines.configs import PackConfig
from pipelines.configs.peers import PeerNetworkConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.dataset.training.mask_noise import MaskNoise
from pipelines.dataset.training.region_frames import read_region_frame
from pipelines.geometry.pointcloud import drawn_indices
from pipelines.geometry.symmetry import NUM_SLOTS, SymmetrySlots
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.learning.peers.peer import KEPT, Arrays, read_peer_frame, storable
from pipelines.network.peers.symmetrynet_input import CROP_SIDE, RegionCrop, region_crop

STORED_POINTS = 1200  # points of a region
UNITS = 10_000.0  # units per metre of stored points
JPEG_QUALITY = 95
JITTER = (0.2, 0.2, 0.2, 0.05)  # largest change of brightness, contrast, saturation, hue angle
NUM_PASTED = 2  # instances that are pasted in front
LEAST_LEFT = 0.5  # share of the points that a pasted instance must leave
LUMA = np.array([0.299, 0.587, 0.114])
YIQ = np.array([LUMA, [0.596, -0.274, -0.322], [0.211, -0.523, 0.312]])


@dataclass(frozen=True)
class LabelledCrop:
    """A region in one frame: its crop, its points (n, 3) in metres, its true symmetries.

    Attributes:
        existence: (5,) 0 or 1 for each slot.
        place: (5, 3) metres, camera frame; 0 where the slot is empty.
        direction: (5, 3) unit; 0 where the slot is empty, and for the sphere.
    """

    crop: RegionCrop
    points: Singles
    existence: Singles
    place: Singles
    direction: Singles

    @property
    def mirrored(self) -> "LabelledCrop":
        """The region in the mirror image of the frame."""
        flip = np.array([-1.0, 1.0, 1.0], np.float32)
        pixels = self.crop.pixels.copy()
        pixels[:, 0] = CROP_SIDE - 1 - pixels[:, 0]
        crop = RegionCrop(self.crop.image[:, ::-1], self.crop.mask[:, ::-1], pixels)
        parts = [each * flip for each in (self.points, self.place, self.direction)]
        return LabelledCrop(crop, parts[0], self.existence, *parts[1:])


@dataclass(frozen=True)
class RegionCrops:
    """B regions of a training step, N points each; `place` and `direction` as in `LabelledCrop`.

    Attributes:
        image: (B, S, S, 3) uint8.
        jitter: (B, 3, 4) change of the colours, for `normalised_colors`.
        pixels: (B, N, 2) uint8 columns and rows.
        points: (B, N, 3) metres, camera frame.
    """

    image: Tensor
    jitter: Tensor
    pixels: Tensor
    points: Tensor
    existence: Tensor
    place: Tensor
    direction: Tensor

    def to(self, device: torch.device) -> "RegionCrops":
        """Return the regions on a device."""
        return RegionCrops(*(getattr(self, each.name).to(device) for each in fields(self)))


def symmetrynet_frame(
    root: GraspNetRoot, files: FrameFiles, network: PeerNetworkConfig | None = None
) -> Arrays:
    """Return the regions of a frame, with the sizes and disturbed masks of `pack`.

    For r regions: `jpeg` bytes of all crops and `jpeg_end` (r,); `mask` (r, S, S/8) bits; `pixels`
    and `points` of all regions, `points_end` (r,); `existence`, `place`, `direction`.
    """
    config = PackConfig()
    seen = read_region_frame(root, files, config.min_pixels)
    frame = seen.frame
    scene = SceneCloud(np.asarray(frame.depth, np.float64), frame.intrinsics)
    noise = MaskNoise(config.mask_noise_share, config.mask_edge, config.mask_blot)
    rng = np.random.default_rng([files.scene_id, files.frame_id])
    regions = []
    for instance in seen.regions:
        cloud = RegionCloud.from_mask(noise.applied(instance.mask, rng), scene)
        cloud = cloud[np.flatnonzero(storable(cloud.points))]
        if len(cloud) < config.min_pixels:
            continue
        cloud = cloud[np.sort(rng.permutation(len(cloud))[:STORED_POINTS])]
        pixels, _ = frame.intrinsics.pixels_of(cloud.points)
        slots = SymmetrySlots.from_symmetries(instance.symmetries)
        truth = (
            np.nan_to_num(each).astype(np.float32)
            for each in (slots.probability, slots.point, slots.direction)
        )
        crop = region_crop(frame.color, cloud.mask, pixels)
        regions.append(LabelledCrop(crop, cloud.points.astype(np.float32), *truth))
    return stored(regions)


def stored(regions: Sequence[LabelledCrop]) -> Arrays:
    """Return regions as the arrays of `symmetrynet_frame`."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    jpegs = [cv2.imencode(".jpg", each.crop.image[..., ::-1], quality)[1] for each in regions]

    def joined(parts: list[NDArray[Any]], dtype: type, *shape: int) -> NDArray[Any]:
        return np.concatenate([np.zeros((0, *shape), dtype), *parts]).astype(dtype)

    def stack(parts: list[NDArray[Any]], dtype: type, *shape: int) -> NDArray[Any]:
        return joined([each[None] for each in parts], dtype, *shape)

    masks = [np.packbits(each.crop.mask, axis=1) for each in regions]
    return {
        "jpeg": joined([each.ravel() for each in jpegs], np.uint8),
        "jpeg_end": np.cumsum([each.size for each in jpegs], dtype=np.int64),
        "mask": stack(masks, np.uint8, CROP_SIDE, CROP_SIDE // 8),
        "pixels": joined([each.crop.pixels for each in regions], np.uint8, 2),
        "points": joined([np.round(each.points * UNITS) for each in regions], np.int16, 3),
        "points_end": np.cumsum([len(each.points) for each in regions], dtype=np.int64),
        "existence": stack([each.existence for each in regions], np.float32, NUM_SLOTS),
        "place": stack([each.place for each in regions], np.float32, NUM_SLOTS, 3),
        "direction": stack([each.direction for each in regions], np.float32, NUM_SLOTS, 3),
    }


def restored(arrays: Arrays) -> list[LabelledCrop]:
    """Return the regions of the arrays of `symmetrynet_frame`."""
    regions = []
    jpegs = np.split(arrays["jpeg"], arrays["jpeg_end"][:-1])
    pixels, points = (
        np.split(arrays[name], arrays["points_end"][:-1]) for name in ("pixels", "points")
    )
    for number, existence in enumerate(arrays["existence"]):
        image = np.asarray(cv2.imdecode(jpegs[number], cv2.IMREAD_COLOR), np.uint8)[..., ::-1]
        mask: Mask = np.unpackbits(arrays["mask"][number], axis=1, count=CROP_SIDE).astype(bool)
        crop = RegionCrop(np.ascontiguousarray(image), mask, pixels[number])
        metres = (points[number] / UNITS).astype(np.float32)
        truth = (existence, arrays["place"][number], arrays["direction"][number])
        regions.append(LabelledCrop(crop, metres, *truth))
    return regions


@lru_cache(maxsize=KEPT)
def read_regions(path: Path, row: int) -> list[LabelledCrop]:
    """Read the regions of a frame; they are shared and must not be changed."""
    return restored(read_peer_frame(path, row))


def drawn_region(
    region: LabelledCrop, foreign: Sequence[LabelledCrop], count: int, rng: np.random.Generator
) -> tuple[NDArray[Any], ...]:
    """Return a region for a training step, in the order of `RegionCrops`.

    Colours are jittered, half of the regions are mirrored, and instances `foreign` are pasted in
    front where enough points remain.
    """
    for each in foreign:
        region = covered(region, each, rng)
    if rng.random() < 0.5:
        region = region.mirrored
    points, pixels = _some(region, count, rng)
    truth = region.existence, region.place, region.direction
    return region.crop.image, _jitter(region.crop.image, rng), pixels, points, *truth


def plain_region(region: LabelledCrop, count: int) -> tuple[NDArray[Any], ...]:
    """Return a region unchanged, in the order of `RegionCrops`."""
    points, pixels = _some(region, count, np.random.default_rng(0))
    unchanged = np.eye(3, 4, dtype=np.float32)
    truth = region.existence, region.place, region.direction
    return region.crop.image, unchanged, pixels, points, *truth


def stacked_regions(regions: Sequence[tuple[NDArray[Any], ...]]) -> RegionCrops:
    """Return drawn regions as one batch."""
    columns = [torch.from_numpy(np.stack(each)) for each in zip(*regions, strict=True)]
    return RegionCrops(*columns)


def covered(region: LabelledCrop, other: LabelledCrop, rng: np.random.Generator) -> LabelledCrop:
    """Return `region` with the instance `other` pasted in front at a random place of its crop.

    It stays unchanged if the instance would leave less than `LEAST_LEFT` of the points.
    """
    x, y = rng.integers(-CROP_SIDE + 1, CROP_SIDE, 2).tolist()
    to_rows, from_rows = _overlap(y)
    to_columns, from_columns = _overlap(x)
    part = other.crop.mask[from_rows, from_columns]
    hidden = np.zeros_like(region.crop.mask)
    hidden[to_rows, to_columns] = part
    column, row = region.crop.pixels.T
    left = ~hidden[row, column]
    if left.mean() < LEAST_LEFT:
        return region
    image = region.crop.image.copy()
    image[to_rows, to_columns][part] = other.crop.image[from_rows, from_columns][part]
    crop = RegionCrop(image, region.crop.mask & ~hidden, region.crop.pixels[left])
    return replace(region, crop=crop, points=region.points[left])


def _overlap(shift: int) -> tuple[slice, slice]:
    """Return the slices of a fixed crop and of a moved crop that overlap."""
    low, high = max(shift, 0), min(CROP_SIDE + shift, CROP_SIDE)
    return slice(low, high), slice(low - shift, high - shift)


def _some(
    region: LabelledCrop, count: int, rng: np.random.Generator
) -> tuple[Singles, NDArray[np.uint8]]:
    """Return `count` points of a region and their pixels, some twice if there are fewer."""
    chosen = drawn_indices(len(region.points), count, rng)
    return region.points[chosen], region.crop.pixels[chosen]


def _jitter(image: NDArray[np.uint8], rng: np.random.Generator) -> Singles:
    """Return random changes (3, 4) of brightness, contrast, saturation and hue of an image."""
    bright, contrast, saturation = (1.0 + rng.uniform(-most, most) for most in JITTER[:3])
    angle = 2.0 * np.pi * rng.uniform(-JITTER[3], JITTER[3])
    turn = np.eye(3)
    turn[1:, 1:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    hue = np.linalg.inv(YIQ) @ turn @ YIQ
    mixed = saturation * np.eye(3) + (1.0 - saturation) * LUMA
    grey = bright * float(image[::4, ::4].mean(axis=(0, 1)) @ LUMA) / 255.0
    matrix = bright * contrast * hue @ mixed
    offset = np.full((3, 1), (1.0 - contrast) * grey)
    return np.concatenate([matrix, offset], axis=1).astype(np.float32)
