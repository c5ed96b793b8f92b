"""Planes of point clouds, and choices of their points; metres, any frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices
from pipelines.geometry.numerics.point_cells import cell_keys, first_of_each


@dataclass(frozen=True)
class Plane:
    """The plane n . p + offset = 0 with unit `normal` (3,)."""

    normal: Array
    offset: float

    def height(self, points: ArrayLike) -> Array:
        """Return the signed distance (...) of `points` (..., 3), positive along the normal."""
        return np.asarray(np.asarray(points, np.float64) @ self.normal + self.offset)

    def facing(self, viewpoint: ArrayLike) -> "Plane":
        """Return the same plane with its normal toward `viewpoint` (3,)."""
        return self if self.height(viewpoint) >= 0 else Plane(-self.normal, -self.offset)


def drawn_indices(available: int, count: int, rng: np.random.Generator) -> Indices:
    """Return the indices (count,) of points drawn from `available` points, in random order.

    No point is drawn twice, unless there are fewer than `count`: then all are drawn, some again.
    """
    chosen = rng.permutation(available)[:count]
    if available < count:
        chosen = np.concatenate([chosen, rng.integers(available, size=count - available)])
    return chosen


def voxel_downsample(points: ArrayLike, size: float) -> Indices:
    """Return indices (k,), ascending, of `points` (n, 3): one in each cube of `size` metres."""
    return first_of_each(cell_keys(np.asarray(points, np.float64), size))
