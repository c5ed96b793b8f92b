"""Nearest neighbours among few points: comparing with all of them is faster than a tree.

A tree is worth its while from a thousand points on; a region that is fitted has some hundred. Nor
does it pay to put them in order and to leave out those that are far along an axis: they would be
looked at one by one, and all are compared many at a time.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices, Singles
from pipelines.geometry.numerics.compiled import compiled

ABREAST = 16  # distances that are looked through at once


@dataclass(frozen=True)
class Neighbours:
    """The n points among which nearest ones are looked for, any frame, metres.

    Attributes:
        points: (n, 3).
        middle: (3,) of them.
        about: (3, n) them about it, in single precision.
    """

    points: Array
    middle: Array
    about: Singles

    @classmethod
    def of(cls, points: Array) -> "Neighbours":
        """Return `points` (n, 3) as what is looked among."""
        middle = points.mean(axis=0)
        return cls(points, middle, np.ascontiguousarray((points - middle).T, np.float32))

    def nearest(self, queries: Array) -> tuple[Array, Indices]:
        """Return the distance (...) of `queries` (..., 3) to the nearest point, and which.

        Of points that are equally near to a micrometre, either is returned.
        """
        asked = np.ascontiguousarray(queries).reshape(-1, 3)
        away, nearest = _nearest(self.points, self.about, self.middle, asked)
        return away.reshape(queries.shape[:-1]), nearest.reshape(queries.shape[:-1])


def nearest_of(points: Array, queries: Array) -> tuple[Array, Indices]:
    """Return how far `queries` (..., 3) are from the nearest of `points` (n, 3), and which."""
    return Neighbours.of(points).nearest(queries)


@compiled
def _nearest(points: Array, about: Singles, middle: Array, queries: Array) -> tuple[Array, Indices]:
    """Return (q,) distances and indices; `about`: (3, n) the points about their `middle` (3,)."""
    away, nearest = np.empty(len(queries)), np.empty(len(queries), np.intp)
    squared = np.empty(about.shape[1], np.float32)
    # Floats that are not negative are ordered as the whole numbers with the same bits are, whose
    # minimum is found many at a time.
    bits = squared.view(np.int32)
    for q in range(len(queries)):
        x = np.float32(queries[q, 0] - middle[0])
        y = np.float32(queries[q, 1] - middle[1])
        z = np.float32(queries[q, 2] - middle[2])
        for n in range(len(squared)):
            u, v, w = about[0, n] - x, about[1, n] - y, about[2, n] - z
            squared[n] = u * u + v * v + w * w
        least = bits[0]
        for n in range(len(bits)):
            least = min(least, bits[n])
        found = 0
        while found + ABREAST <= len(bits):
            here = np.int32(0)
            for n in range(ABREAST):
                here |= np.int32(bits[found + n] == least)
            if here:
                break
            found += ABREAST
        while bits[found] != least:
            found += 1
        nearest[q], total = found, 0.0
        for axis in range(3):
            total += (queries[q, axis] - points[found, axis]) ** 2
        away[q] = np.sqrt(total)
    return away, nearest
