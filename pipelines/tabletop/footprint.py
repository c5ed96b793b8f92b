"""The extent of a table on its plane."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import basis_from_direction

GRID_CELL = 0.01  # metres, edge of the cells of a footprint


@dataclass(frozen=True)
class Footprint:
    """Convex hull of points on a plane, widened by a margin, as a grid of cells."""

    axes: Array  # (3, 2) along the plane
    low: Array  # (2,) metres, corner of the grid
    cells: NDArray[np.uint8]

    @classmethod
    def around(cls, points: Array, plane: Plane, margin: float) -> "Footprint":
        """Return the footprint of `points` (n, 3) on `plane`; `margin` in metres."""
        axes = basis_from_direction(plane.normal)[:, 1:]
        if len(points) < 3:
            return cls(axes, np.zeros(2), np.zeros((1, 1), np.uint8))
        flat = axes.T @ points.T  # (2, n): several times faster than (n, 2)
        low = flat.min(axis=1) - margin - GRID_CELL
        width, height = ((flat.max(axis=1) - low + margin) / GRID_CELL).astype(int) + 2
        cells = np.zeros((height, width), np.uint8)
        columns, rows = ((flat - low[:, None]) / GRID_CELL).astype(np.int32)
        cells[rows, columns] = 1
        cv2.fillConvexPoly(cells, cv2.convexHull(_ends_of_rows(cells)), 1)
        size = 2 * round(margin / GRID_CELL) + 1
        wide = cv2.dilate(cells, np.ones((size, size), np.uint8))
        return cls(axes, low, np.asarray(wide, np.uint8))

    def contains(self, points: Array) -> Mask:
        """Return a mask (n,) of the `points` (n, 3) that lie over the footprint."""
        flat = self.axes.T @ points.T
        columns, rows = np.floor((flat - self.low[:, None]) / GRID_CELL).astype(np.int64)
        height, width = self.cells.shape
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        cell = np.where(inside, rows * width + columns, 0)
        return np.asarray(inside & (self.cells.take(cell) > 0))


def _ends_of_rows(cells: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return the first and last set cell (n, 2) (column, row) of each row, for a convex hull."""
    rows = np.flatnonzero(cells.any(axis=1))
    first = cells[rows].argmax(axis=1)
    last = cells.shape[1] - 1 - cells[rows, ::-1].argmax(axis=1)
    ends = np.concatenate([np.stack([first, rows], 1), np.stack([last, rows], 1)])
    return ends.astype(np.int32)
