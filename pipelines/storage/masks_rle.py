"""Run-length encoded masks: COCO's uncompressed form, column by column, zeros first."""

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask, Singles
from pipelines.contents import MAX_PIXELS
from pipelines.errors import ValueRangeError


def encode_mask(mask: Mask) -> NDArray[np.uint32]:
    """Return the run lengths (k,) of `mask` (H, W) read down the columns; the first is of zeros."""
    flat = np.asarray(mask, dtype=bool).ravel(order="F")
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    starts = [0, 0] if flat[:1].any() else [0]
    return np.diff(changes, prepend=starts, append=flat.size).astype(np.uint32)


def decode_mask(counts: NDArray[np.integer], width: int, height: int) -> Mask:
    """Return the mask (H, W) of the run lengths `counts` (k,).

    Raises:
        ValueRangeError: the runs do not fill the image.
    """
    if int(np.sum(counts)) != width * height or width * height > MAX_PIXELS:
        raise ValueRangeError("sum of mask_counts", int(np.sum(counts)), f"{width}x{height}")
    values = np.arange(len(counts)) % 2 == 1
    return np.repeat(values, counts).reshape((height, width), order="F")


def box_of_mask(mask: Mask) -> Singles:
    """Return the box (4,) x0, y0, x1, y1 of `mask` (H, W): pixel edges, x1 and y1 exclusive."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return np.zeros(4, dtype=np.float32)
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float32)
