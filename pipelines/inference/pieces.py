"""The pieces of a region in which the depth alone sees several things (D. 97)."""

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import InferConfig

Mask = NDArray[np.bool_]


def pieces_of(mask: Mask, labels: NDArray[np.int32], config: InferConfig) -> list[Mask]:
    """Return the pieces (H, W) of `mask` (H, W), the largest first; none where it is one thing.

    `labels` (H, W) number the geometric regions, 0 elsewhere. What is smaller than
    `min_region_pixels`, or than a share `min_piece_share` of the mask, is no piece.
    """
    sizes = np.bincount(labels[mask], minlength=1)
    sizes[0] = 0
    least = max(config.min_region_pixels, config.min_piece_share * np.count_nonzero(mask))
    numbers = np.flatnonzero(sizes >= least)
    if len(numbers) < 2:
        return []
    numbers = numbers[np.argsort(-sizes[numbers], kind="stable")]
    return [mask & (labels == number) for number in numbers]
