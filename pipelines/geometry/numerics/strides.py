"""Every k-th row of an array, the first included: fewer rows, evenly spread over their order."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)


def strided_at_least(rows: NDArray[T], count: int) -> NDArray[T]:
    """Return at least `count` of `rows` (n, ...), and at most twice as many; all of fewer rows."""
    return rows[:: max(1, len(rows) // count)]


def strided_at_most(rows: NDArray[T], count: int) -> NDArray[T]:
    """Return at most `count` of `rows` (n, ...)."""
    return rows[:: max(1, -(-len(rows) // count))]
