"""Points sorted into cubes, to rule out a whole cube of points in a collision check.

The points of a cube are inside a ball about the middle of their bounding box. A body farther from
the ball's centre than the ball's radius touches no point of the cube.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Singles
from pipelines.geometry.numerics.compiled import compiled

BALL_MARGIN = 1e-6  # metres added to a ball's radius, for the rounding of single precision
SPREAD = 0x9E3779B97F4A7C15  # 2^64 over the golden ratio: the high bits of its multiples spread
WORD = 64  # bits


@dataclass(frozen=True)
class PointCells:
    """n points in c cubes, any frame, metres."""

    index: Indices  # (n,) index of each point in the original array, cube by cube
    points: Singles  # (3, n) points, cube by cube
    start: Indices  # (c + 1,) first index of each cube in `index` and `points`, and n
    center: Singles  # (3, c) centres of balls around the points of each cube
    radius: Singles  # (c,) radii of these balls

    @classmethod
    def of(cls, points: Array, size: float) -> "PointCells":
        """Sort `points` (n, 3) into cubes of edge `size` metres."""
        place, _, count = _places(cell_keys(points, size))
        return cls(*_gathered(np.ascontiguousarray(points, np.float64), place, count))

    def __len__(self) -> int:
        return len(self.radius)


def cell_keys(points: Array, size: float) -> Indices:
    """Return the number (n,) of the cube of edge `size` metres around each of `points` (n, 3).

    Cubes start at the lowest coordinates; numbers ascend by x, then y, then z.
    """
    return _keys(np.ascontiguousarray(points, np.float64), size)


def first_of_each(key: Indices) -> Indices:
    """Return the first index of each value of `key` (n,), in ascending order."""
    return _places(key)[1]


@compiled
def _keys(points: Array, size: float) -> Indices:
    key = np.empty(len(points), np.int64)
    if not len(points):
        return key
    x0, y0, z0 = points[0]
    x1, y1, z1 = points[0]
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        x0, y0, z0 = min(x0, x), min(y0, y), min(z0, z)
        x1, y1, z1 = max(x1, x), max(y1, y), max(z1, z)
    rows, columns = int((y1 - y0) / size) + 1, int((z1 - z0) / size) + 1
    for n in range(len(points)):
        x, y, z = (points[n, 0] - x0) / size, (points[n, 1] - y0) / size, (points[n, 2] - z0) / size
        key[n] = (int(x) * rows + int(y)) * columns + int(z)
    return key


@compiled
def _places(key: Indices) -> tuple[Indices, Indices, Indices]:
    """Return the number (n,) of each key's value, and first index and count (c,) of each value.

    Values are numbered in order of first occurrence, by a hash table with linear probing.
    """
    bits = 4
    while 1 << bits < 2 * len(key):
        bits += 1
    shift, last = np.uint64(WORD - bits), (1 << bits) - 1
    table = np.full(1 << bits, -1, np.int32)
    place = np.empty(len(key), np.int64)
    first, count = np.empty(len(key), np.int64), np.zeros(len(key), np.int64)
    found = 0
    for n in range(len(key)):
        slot = np.int64((np.uint64(key[n]) * np.uint64(SPREAD)) >> shift)
        while table[slot] >= 0 and key[first[table[slot]]] != key[n]:
            slot = (slot + 1) & last
        if table[slot] < 0:
            table[slot] = found
            first[found] = n
            found += 1
        place[n] = table[slot]
        count[place[n]] += 1
    return place, first[:found].copy(), count[:found].copy()


@compiled
def _gathered(
    points: Array, place: Indices, count: Indices
) -> tuple[Indices, Singles, Indices, Singles, Singles]:
    """Return the fields of `PointCells`; `place`: (n,) cube of each point, `count`: (c,) points."""
    start = np.zeros(len(count) + 1, np.int64)
    for c in range(len(count)):
        start[c + 1] = start[c] + count[c]
    free, index = start[:-1].copy(), np.empty(len(place), np.int64)
    ordered = np.empty((3, len(place)), np.float32)
    low, high = np.full((3, len(count)), np.inf), np.full((3, len(count)), -np.inf)
    for n in range(len(place)):
        c = place[n]
        index[free[c]] = n
        for axis in range(3):
            ordered[axis, free[c]] = points[n, axis]
            low[axis, c] = min(low[axis, c], points[n, axis])
            high[axis, c] = max(high[axis, c], points[n, axis])
        free[c] += 1
    center, radius = np.empty((3, len(count)), np.float32), np.empty(len(count), np.float32)
    for c in range(len(count)):
        square = 0.0
        for axis in range(3):
            center[axis, c] = 0.5 * (low[axis, c] + high[axis, c])
            square += (high[axis, c] - low[axis, c]) ** 2
        radius[c] = 0.5 * np.sqrt(square) + BALL_MARGIN
    return index, ordered, start, center, radius
