"""A region seen along an approach: the depth of its nearest point in each cell of a grid."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.transforms import basis_from_direction

MIN_CELL, MAX_CELLS = 0.002, 120  # metres; cells along the longer side
MARGIN = 3  # empty cells about the region


@dataclass(frozen=True)
class HeightMap:
    """A region seen along `approach`: the nearest point of each cell."""

    axes: Array  # (3, 3) columns approach, right, down
    low: Array  # (2,) metres, corner of the grid
    cell: float
    depth: Array  # (rows, columns) metres along approach, inf where empty

    @classmethod
    def of(cls, points: Array, approach: Array) -> "HeightMap":
        """Return the map of `points` (n, 3), metres, along the unit `approach` (3,)."""
        axes = basis_from_direction(approach)
        low, cell, depth = _nearest_in_cells(points @ axes)
        measured = np.isfinite(depth).astype(np.uint8)
        # Small gaps between measured cells are closed.
        inside = cv2.morphologyEx(measured, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
        depth = _filled(depth, np.asarray(inside, np.uint8))
        return cls(axes, low - MARGIN * cell, cell, depth)

    def across(self, direction: Array) -> Array:
        """Return (2,) the part of `direction` (3,) on the plane across the approach."""
        return np.asarray(direction @ self.axes[:, 1:])

    def points_at(self, pixels: Array, depth: float) -> Array:
        """Return (n, 3) camera-frame points of `pixels` (n, 2) as (column, row) at `depth`."""
        flat = self.low + (pixels + 0.5) * self.cell
        return np.asarray(flat @ self.axes[:, 1:].T + depth * self.axes[:, 0])


@compiled
def _nearest_in_cells(local: Array) -> tuple[Array, float, Array]:
    """Return the lowest right and down of `local` (n, 3), the cell and (rows, columns) depths.

    Those of the nearest point of each cell, inf where there is none.
    """
    x0, y0, x1, y1 = local[0, 1], local[0, 2], local[0, 1], local[0, 2]
    for n in range(len(local)):
        x0, y0 = min(x0, local[n, 1]), min(y0, local[n, 2])
        x1, y1 = max(x1, local[n, 1]), max(y1, local[n, 2])
    cell = max(MIN_CELL, max(x1 - x0, y1 - y0) / MAX_CELLS)
    rows, columns = int((y1 - y0) / cell) + 1, int((x1 - x0) / cell) + 1
    depth = np.full((rows + 2 * MARGIN, columns + 2 * MARGIN), np.inf)
    for n in range(len(local)):
        row = int((local[n, 2] - y0) / cell) + MARGIN
        column = int((local[n, 1] - x0) / cell) + MARGIN
        depth[row, column] = min(depth[row, column], local[n, 0])
    return np.array((x0, y0)), cell, depth


@compiled
def _filled(depth: Array, inside: NDArray[np.uint8]) -> Array:
    """Return `depth` (h, w) with cells `inside` and not measured as near as the nearest around."""
    height, width = depth.shape
    filled = depth.copy()
    for row in range(height):
        for column in range(width):
            if inside[row, column] == 0 or depth[row, column] < np.inf:
                continue
            for i in range(max(row - 2, 0), min(row + 3, height)):
                for j in range(max(column - 2, 0), min(column + 3, width)):
                    filled[row, column] = min(filled[row, column], depth[i, j])
    return filled
