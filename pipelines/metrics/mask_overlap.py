"""Overlaps of region masks: intersection over union, and the object under a region."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask


def mask_iou(masks: Sequence[Mask], others: Sequence[Mask]) -> Array:
    """Return (p, t) intersection over union of p `masks` and t `others`, all (H, W)."""
    if not masks or not others:
        return np.zeros((len(masks), len(others)))
    # Products of 0/1 matrices count pixels; float32 is exact up to 16 million pixels.
    a = np.stack([mask.ravel() for mask in masks]).astype(np.float32)
    b = np.stack([mask.ravel() for mask in others]).astype(np.float32)
    common = (a @ b.T).astype(np.float64)
    union = a.sum(axis=1)[:, None] + b.sum(axis=1)[None] - common
    return np.asarray(common / np.maximum(union, 1.0))


def owner_of(mask: Mask, label: NDArray[np.integer], min_share: float) -> int:
    """Return the value of `label` (H, W) on most pixels of `mask`, 0 (background) for none.

    This owner must cover at least `min_share` of the mask's pixels.
    """
    covered = label[mask]
    counts = np.bincount(covered[covered > 0].astype(np.int64), minlength=1)
    owner = int(counts.argmax())
    return owner if counts[owner] >= max(min_share * covered.size, 1.0) else 0
