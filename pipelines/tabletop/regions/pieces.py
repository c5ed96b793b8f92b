"""Pieces of a labelled image: their pixels, points and bounding boxes."""

from dataclasses import dataclass

import cv2
import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.numerics.compiled import compiled
from pipelines.tabletop.depth_segments import Labels

Box = tuple[slice, slice]

UNMEASURED = 16  # pixels at the border of the image that a sensor may not measure


@dataclass(frozen=True)
class LabelledPiece:
    """A labelled piece: flat pixels (n,), their points (n, 3), bounding box in the image."""

    label: int
    pixels: Indices
    points: Array
    box: Box


def pieces_of_labels(labels: Labels, xyz: Array, min_pixels: int) -> list[LabelledPiece]:
    """Return the pieces of `labels` (H, W) with at least `min_pixels`, by ascending label.

    `xyz`: (H, W, 3) metres, camera frame.
    """
    order, end = _by_label(labels.ravel(), int(labels.max(initial=0)))
    found = []
    for label in np.flatnonzero(np.diff(end) >= min_pixels) + 1:
        pixels = order[end[label - 1] : end[label]]
        rows, columns = np.divmod(pixels, labels.shape[1])
        box = slice(rows[0], rows[-1] + 1), slice(columns.min(), columns.max() + 1)
        found.append(
            LabelledPiece(int(label), pixels, xyz.reshape(-1, 3).take(pixels, axis=0), box)
        )
    return found


def with_margin(box: Box, margin: int) -> Box:
    """Return `box` with `margin` more pixels on each side, from row and column 0 on."""
    rows, columns = (slice(max(0, side.start - margin), side.stop + margin) for side in box)
    return rows, columns


def box_of(mask: Mask) -> Box:
    """Return the rows and columns that `mask` (H, W) spans; empty slices for an empty mask."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    return slice(y, y + height), slice(x, x + width)


@compiled
def _by_label(labels: Labels, count: int) -> tuple[Indices, Indices]:
    """Return the indices of labels 1 to `count`, label by label, and the ends (count + 1,).

    `labels`: (n,). The indices of a label ascend; label 0 is omitted and ends at 0.
    """
    end = np.zeros(count + 1, np.int64)
    for n in range(len(labels)):
        if labels[n] > 0:
            end[labels[n]] += 1
    end = np.cumsum(end)
    free, order = end.copy(), np.empty(end[-1], np.int64)
    for n in range(len(labels) - 1, -1, -1):
        if labels[n] > 0:
            free[labels[n]] -= 1
            order[free[labels[n]]] = n
    return order, end
