"""Points sorted into cubes, so that what lies far from a body is ruled out a cube at a time.

A cube's points lie in a ball about the middle of their own box; a body farther from the ball's
centre than its radius touches none of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

ROUNDING = 1e-6  # metres by which a ball is widened, for what single precision rounds off
DIGIT = 16  # bits


@dataclass(frozen=True)
class PointCells:
    """n points in c cubes, any frame, metres.

    Attributes:
        index: (n,) the points' places in the array they came from, cube by cube.
        start: (c + 1,) where each cube's points start and end in `index`.
        centre: (c, 3) of balls around the points of each cube.
        radius: (c,) of these balls.
    """

    index: Indices
    start: Indices
    centre: Array
    radius: Array

    @classmethod
    def of(cls, points: Array, size: float) -> "PointCells":
        """Sort `points` (n, 3) into cubes of edge `size` metres."""
        if not len(points):
            return cls(np.zeros(0, np.int64), np.zeros(1, np.int64), np.zeros((0, 3)), np.zeros(0))
        key = cell_keys(points, size)
        index = ascending_order(key)
        start = np.flatnonzero(np.diff(key[index], prepend=-1))
        # An axis at a time, each in one piece: half the time of rows of three.
        ordered = [axis[index] for axis in points.T]
        low = np.stack([np.minimum.reduceat(axis, start) for axis in ordered])
        high = np.stack([np.maximum.reduceat(axis, start) for axis in ordered])
        radius = 0.5 * np.linalg.norm(high - low, axis=0) + ROUNDING
        return cls(index, np.append(start, len(points)), (low + high).T / 2.0, radius)

    def __len__(self) -> int:
        return len(self.radius)

    def members(self, touched: Mask) -> tuple[Indices, Indices]:
        """Return the points of the cubes `touched` (m, c) by each of m bodies.

        Returns:
            How many each body has (m,), and their places (sum,), body by body.
        """
        body, cell = np.nonzero(touched)
        sizes = np.diff(self.start)[cell]
        ends = np.cumsum(sizes)
        shift = np.repeat(self.start[cell] - (ends - sizes), sizes)
        places = self.index[shift + np.arange(len(shift))]
        counts = np.bincount(body, sizes, minlength=len(touched)).astype(np.int64)
        return counts, places


def cell_keys(points: Array, size: float) -> Indices:
    """Return (n,) a number for the cube of edge `size` each of `points` (n, 3) lies in.

    Cubes start at the lowest coordinates; numbers ascend by x, then y, then z.
    """
    key = np.zeros(len(points), np.int64)
    for axis in points.T:
        cell = ((axis - axis.min()) / size).astype(np.int64)  # none is negative
        key *= int(cell.max()) + 1
        key += cell
    return key


def ascending_order(key: Indices) -> Indices:
    """Return `argsort(key, kind="stable")` of `key` (n,), none negative.

    Numbers of 16 bits are sorted by counting, not by comparing: digit by digit, the lowest first,
    takes a fifth of the time.
    """
    order = np.argsort(key.astype(np.uint16), kind="stable")
    for shift in range(DIGIT, int(key.max(initial=0)).bit_length(), DIGIT):
        digit = (key >> shift).astype(np.uint16)
        order = order[np.argsort(digit[order], kind="stable")]
    return order


def first_of_each(key: Indices) -> tuple[Indices, Indices]:
    """Return where each value of `key` (n,) comes first, by ascending value, and how often.

    As `np.unique` does; none may be negative.
    """
    order = ascending_order(key)
    start = np.flatnonzero(np.diff(key[order], prepend=-1))
    return order[start], np.diff(start, append=len(key))
