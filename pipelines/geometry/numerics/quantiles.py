"""Quantiles of a few hundred to a few thousand numbers, by sorting them once.

For so few numbers, sorting takes a fifth to a tenth of the time of `np.percentile`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array


def quantiles(values: ArrayLike, shares: float | Sequence[float]) -> Array:
    """Return the quantiles (..., q) at `shares`, 0 to 1, of `values` (..., n) on the last axis.

    Interpolation is linear; for a single share, the axis q is omitted.
    """
    ordered = np.sort(np.asarray(values, np.float64), axis=-1)
    place = np.asarray(shares) * (ordered.shape[-1] - 1)
    below = np.floor(place).astype(np.intp)
    low, high = ordered[..., below], ordered[..., np.ceil(place).astype(np.intp)]
    return np.asarray(low + (place - below) * (high - low))


def median(values: ArrayLike) -> Array:
    """Return the median (...) of `values` (..., n) on the last axis."""
    return quantiles(values, 0.5)
