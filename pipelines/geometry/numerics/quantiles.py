"""Quantiles of a few hundred to a few thousand numbers, in order once instead of picked out.

Sorting so few takes a fifth to a tenth of what `np.percentile` and `np.median` take.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array


def quantiles(values: ArrayLike, shares: float | Sequence[float]) -> Array:
    """Return (..., q) for each of `shares`, 0 to 1, of `values` (..., n) along their last axis.

    Between two values as far as the share lies between theirs; without the axis q for one share.
    """
    ordered = np.sort(np.asarray(values, np.float64), axis=-1)
    place = np.asarray(shares) * (ordered.shape[-1] - 1)
    below = np.floor(place).astype(np.intp)
    low, high = ordered[..., below], ordered[..., np.ceil(place).astype(np.intp)]
    return np.asarray(low + (place - below) * (high - low))


def median(values: ArrayLike) -> Array:
    """Return (...) the median of `values` (..., n) along their last axis."""
    return quantiles(values, 0.5)
