"""How far a table extends: the ground that points on a plane cover."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import basis_from_direction

CELL = 0.01  # metres, of the grid on the plane that its extent is drawn into


@dataclass(frozen=True)
class Footprint:
    """The convex hull of points on a plane, widened by a margin, drawn into a grid of cells."""

    axes: Array  # (3, 2) along the plane
    low: Array  # (2,) metres, corner of the grid
    cells: NDArray[np.uint8]

    @classmethod
    def around(cls, points: Array, plane: Plane, margin: float) -> "Footprint":
        """Return the footprint of `points` (n, 3) on `plane`; `margin` in metres."""
        axes = basis_from_direction(plane.normal)[:, 1:]
        if len(points) < 3:
            return cls(axes, np.zeros(2), np.zeros((1, 1), np.uint8))
        flat = axes.T @ points.T  # a row an axis: several times faster to go through
        low = flat.min(axis=1) - margin - CELL
        width, height = ((flat.max(axis=1) - low + margin) / CELL).astype(int) + 2
        cells = np.zeros((height, width), np.uint8)
        columns, rows = ((flat - low[:, None]) / CELL).astype(np.int32)
        cells[rows, columns] = 1
        cv2.fillConvexPoly(cells, cv2.convexHull(_ends_of_rows(cells)), 1)
        size = 2 * round(margin / CELL) + 1
        wide = cv2.dilate(cells, np.ones((size, size), np.uint8))
        return cls(axes, low, np.asarray(wide, np.uint8))

    def contains(self, points: Array) -> Mask:
        """Return which of `points` (n, 3) lie over it."""
        flat = self.axes.T @ points.T
        columns, rows = np.floor((flat - self.low[:, None]) / CELL).astype(np.int64)
        height, width = self.cells.shape
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        cell = np.where(inside, rows * width + columns, 0)
        return np.asarray(inside & (self.cells.take(cell) > 0))


def _ends_of_rows(cells: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return (n, 2) the first and last set cell (column, row) of each row: the hull's corners."""
    rows = np.flatnonzero(cells.any(axis=1))
    first = cells[rows].argmax(axis=1)
    last = cells.shape[1] - 1 - cells[rows, ::-1].argmax(axis=1)
    ends = np.concatenate([np.stack([first, rows], 1), np.stack([last, rows], 1)])
    return ends.astype(np.int32)
