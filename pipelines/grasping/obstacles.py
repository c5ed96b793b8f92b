"""Points that a gripper may meet, sorted into cubes for tests against its bodies."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipelines.array_types import Array, Counts, Singles
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.point_cells import PointCells

CELL = 0.02  # metres, edge of the cubes

# As in `gripper_bodies`: points, their counts, and of each cube: ends, centre, radius.
Cells = tuple[Singles, Counts, Counts, Singles, Singles]


@dataclass(frozen=True)
class Obstacles:
    """Points (n, 3) that a gripper may meet; each represents `count` (n,) measured points."""

    points: Array
    count: Counts

    @cached_property
    def _about(self) -> tuple[Array, Array]:
        """(3,) the points' mean, (n, 3) the points relative to the mean."""
        return _about_middle(self.points)

    @property
    def center(self) -> Array:
        """(3,) their mean; single precision is a micrometre at arm's length, and finer near it."""
        return self._about[0]

    @cached_property
    def cells(self) -> Cells:
        """The points in cubes about the centre, for the compiled loops of `gripper_bodies`."""
        cells = PointCells.of(self._about[1], CELL)
        return cells.points, self.count[cells.index], cells.start, cells.center, cells.radius


@compiled
def _about_middle(points: Array) -> tuple[Array, Array]:
    """Return the mean (3,) of `points` (n, 3), zeros if empty, and the points minus the mean."""
    x, y, z, count = 0.0, 0.0, 0.0, max(len(points), 1)
    for n in range(len(points)):
        x, y, z = x + points[n, 0], y + points[n, 1], z + points[n, 2]
    x, y, z = x / count, y / count, z / count
    about = np.empty((len(points), 3))
    for n in range(len(points)):
        about[n, 0], about[n, 1], about[n, 2] = points[n, 0] - x, points[n, 1] - y, points[n, 2] - z
    return np.array((x, y, z)), about
