"""Errors of a detector, added to true masks for training: moved edges, leaks, lost parts."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask
from pipelines.tabletop.regions.pieces import box_of, with_margin

SMALLEST = 0.3  # of a largest radius: least radius that is drawn


@dataclass(frozen=True)
class MaskNoise:
    """Small errors of masks; lengths are in units of the square root of the mask's area.

    Attributes:
        share: share of the masks that are changed.
        edge: largest erosion or dilation.
        blot: largest radius of a disc at the outline that is added or removed.
    """

    share: float
    edge: float
    blot: float

    def applied(self, mask: Mask, rng: np.random.Generator) -> Mask:
        """Return `mask` (H, W) changed at random; never empty unless `mask` is."""
        if not mask.any() or rng.uniform() >= self.share:
            return mask
        size = float(np.sqrt(mask.sum()))
        margin = int(np.ceil(size * (self.edge + self.blot))) + 2
        window = with_margin(box_of(mask), margin)
        changed = _moved_edge(mask[window].astype(np.uint8), size * self.edge, rng)
        changed = _blotted(changed, size * self.blot, rng)
        if not changed.any():
            return mask
        noisy = np.zeros_like(mask)
        noisy[window] = changed > 0
        return noisy


def _moved_edge(
    mask: NDArray[np.uint8], reach: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    radius = round(rng.uniform(-reach, reach))
    if radius == 0:
        return mask
    side = 2 * abs(radius) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    moved = cv2.dilate(mask, disc) if radius > 0 else cv2.erode(mask, disc)
    return np.asarray(moved, np.uint8)


def _blotted(mask: NDArray[np.uint8], reach: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return `mask` with a disc at its outline filled or cleared, in half of the cases."""
    inner = cv2.erode(mask, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero(mask != inner)
    fill, pick = int(rng.integers(4)), rng.uniform()
    if fill > 1 or not len(rows):
        return mask
    at = int(pick * len(rows))
    blotted = mask.copy()
    radius = round(rng.uniform(SMALLEST, 1.0) * reach)
    cv2.circle(blotted, (int(columns[at]), int(rows[at])), radius, fill, cv2.FILLED)
    return blotted


@dataclass(frozen=True)
class MaskFaults:
    """Large errors of masks: two objects detected as one, or half an object as the whole.

    Attributes:
        leak: share of the masks that gain a part of a neighbour they touch.
        cut: share of the masks that lose the pixels beyond a line across them.
        reach: largest radius of a leak, in units of the square root of the mask's area.
        loss: largest share of its pixels that a mask loses by a cut.
    """

    leak: float
    cut: float
    reach: float = 0.6
    loss: float = 0.5

    def applied(self, mask: Mask, others: Mask, rng: np.random.Generator) -> Mask:
        """Return `mask` (H, W) changed at random; `others`: (H, W) pixels of all neighbours."""
        drawn = rng.uniform(size=2)
        if drawn[0] < self.leak:
            mask = leaked(mask, others & ~mask, self.reach * rng.uniform(SMALLEST, 1.0), rng)
        if drawn[1] < self.cut:
            mask = truncated(mask, rng.uniform(0.1, self.loss), rng)
        return mask


def leaked(mask: Mask, others: Mask, reach: float, rng: np.random.Generator) -> Mask:
    """Return `mask` (H, W) with the pixels of `others` in a disc around a pixel where both touch.

    `reach`: radius of the disc, in units of the square root of the mask's area.
    """
    rim = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    rows, columns = np.nonzero(rim & others)
    if not len(rows):
        return mask
    at, disc = int(rng.integers(len(rows))), np.zeros(mask.shape, np.uint8)
    radius = max(1, round(reach * float(np.sqrt(mask.sum()))))
    cv2.circle(disc, (int(columns[at]), int(rows[at])), radius, 1, cv2.FILLED)
    return mask | (others & (disc > 0))


def truncated(mask: Mask, share: float, rng: np.random.Generator) -> Mask:
    """Return `mask` (H, W) without the `share` of its pixels farthest in a random direction."""
    rows, columns = np.nonzero(mask)
    if len(rows) < 2:
        return mask
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = columns * np.cos(angle) + rows * np.sin(angle)
    kept = along <= np.quantile(along, 1.0 - share)
    left = np.zeros_like(mask)
    left[rows[kept], columns[kept]] = True
    return left
