"""Features of boxes (RoIAlign, He et al.) from maps with channels last in memory.

On the CPU, torchvision's RoIAlign copies a whole map into another layout for each level and call.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor
from torchvision.ops import MultiScaleRoIAlign

from pipelines.array_types import Array, Indices, Singles
from pipelines.geometry.numerics.compiled import compiled
from pipelines.network import devices

Taps = tuple[Indices, Indices, Singles]

ROUNDING = 1e-6  # levels, as in torchvision


class ChannelsLastRoIAlign(MultiScaleRoIAlign):  # type: ignore[misc] # untyped library
    """torchvision's `MultiScaleRoIAlign`, on the CPU for `channels_last` maps without gradients."""

    def forward(
        self,
        maps: Mapping[str, Tensor],  # (B, C, h, w) each
        boxes: list[Tensor],  # (n, 4) x0, y0, x1, y1 in pixels, for each image
        sizes: Sequence[tuple[int, int]],  # height and width of each image
    ) -> Tensor:
        """Return the features (N, C, h, w) of all images' boxes, one image after the other."""
        if not devices.on_cpu(boxes[0]):
            features: Tensor = super().forward(maps, boxes, sizes)
            return features
        used = [maps[name] for name in self.featmap_names if name in maps]
        highest = max(height for height, _ in sizes)
        scales = np.exp2([round(math.log2(each.shape[-2] / highest)) for each in used])
        image = np.repeat(np.arange(len(boxes)), [len(each) for each in boxes])
        joined = torch.cat(boxes)
        pooled = _aligned(
            tuple(each.permute(0, 2, 3, 1).contiguous().numpy() for each in used),
            scales.astype(np.float32),
            joined.numpy(),
            (image, self._levels(joined, scales).numpy()),
            (*self.output_size, self.sampling_ratio),
        )
        return torch.from_numpy(pooled).permute(0, 3, 1, 2)

    def _levels(
        self,
        boxes: Tensor,  # (n, 4)
        scales: Array,  # (m,)
    ) -> Tensor:
        """Return (n,) the map of each box by the box's size (Eq. 1 of Feature Pyramid Networks)."""
        size = torch.sqrt((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]))
        level = self.canonical_level + torch.log2(size / self.canonical_scale) + ROUNDING
        first, last = (-math.log2(scale) for scale in (scales[0], scales[-1]))
        return (torch.floor(level).clamp(first, last) - first).long()


@compiled
def _aligned(
    maps: tuple[Singles, ...],
    scales: Singles,
    boxes: Singles,
    where: tuple[Indices, Indices],
    counts: tuple[int, int, int],
) -> Singles:
    """Return (n, rows, columns, C) the mean of the samples in each cell of `boxes` (n, 4).

    `maps`: (B, h, w, C), sizes are the image's times `scales` (m,). `where`: (n,) image and map of
    each box. `counts`: rows, columns, and samples along each side of a cell.
    """
    rows, columns, samples = counts
    channels, one = maps[0].shape[3], np.float32(1.0)
    pooled = np.zeros((len(boxes), rows, columns, channels), np.float32)
    for n in range(len(boxes)):
        image, level = where[0][n], where[1][n]
        features, scale = maps[level], scales[level]
        height, width = features.shape[1], features.shape[2]
        down = _samples(boxes[n, 1] * scale, boxes[n, 3] * scale, rows, samples, height)
        across = _samples(boxes[n, 0] * scale, boxes[n, 2] * scale, columns, samples, width)
        for y in range(rows * samples):
            for x in range(columns * samples):
                top, bottom, v = down[0][y], down[1][y], down[2][y]
                left, right, u = across[0][x], across[1][x], across[2][x]
                if top < 0 or left < 0:
                    continue
                row, column = y // samples, x // samples
                share = (one - v) * (one - u), (one - v) * u, v * (one - u), v * u
                for c in range(channels):
                    pooled[n, row, column, c] += (
                        share[0] * features[image, top, left, c]
                        + share[1] * features[image, top, right, c]
                        + share[2] * features[image, bottom, left, c]
                        + share[3] * features[image, bottom, right, c]
                    )
    return pooled / np.float32(samples * samples)


@compiled
def _samples(start: np.float32, end: np.float32, cells: int, samples: int, length: int) -> Taps:
    """Return the two pixels around each sample along a side of a box, and the second's share.

    `start`, `end`: ends of the side, which has `cells` with `samples` each. For a sample outside
    the map, which is `length` pixels long, the first pixel is -1.
    """
    count = cells * samples
    first, second = np.full(count, -1, np.int64), np.zeros(count, np.int64)
    share = np.zeros(count, np.float32)
    cell = max(end - start, np.float32(1.0)) / np.float32(cells)
    for n in range(count):
        inside = (np.float32(n % samples) + np.float32(0.5)) * cell / np.float32(samples)
        place = start + np.float32(n // samples) * cell + inside
        if -1.0 <= place <= length:  # false for nan too
            place = max(place, np.float32(0.0))
            first[n] = min(int(place), length - 1)
            second[n] = min(first[n] + 1, length - 1)
            share[n] = place - np.float32(first[n]) if second[n] > first[n] else np.float32(0.0)
    return first, second, share
