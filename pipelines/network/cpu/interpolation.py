"""Weighted sums of a few points of a cloud, added to others, compiled."""

import numpy as np

from pipelines.array_types import Floats, Indices
from pipelines.geometry.numerics.compiled import compiled


@compiled
def add_interpolated(
    rectifies: bool, coarse: Floats, places: Indices, weights: Floats, fine: Floats
) -> None:
    """Add to `fine` (m, c) the weighted sums of rows (n, c) of `coarse`.

    `places` and `weights` are (m, 3). Where it `rectifies`, nothing below zero is left.
    """
    least = fine.dtype.type(0.0 if rectifies else -np.inf)
    for m in range(len(fine)):
        i, j, k = places[m, 0], places[m, 1], places[m, 2]
        u, v, w = weights[m, 0], weights[m, 1], weights[m, 2]
        for c in range(fine.shape[1]):
            value = u * coarse[i, c] + v * coarse[j, c] + w * coarse[k, c] + fine[m, c]
            fine[m, c] = least if value < least else value
