"""Nearest neighbours among a few hundred points, by comparison with all points.

A k-d tree is faster only from about a thousand points on. Sorting the points along an axis does not
help: the comparisons are vectorised, which a search along the axis would prevent.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices, Singles
from pipelines.geometry.numerics.compiled import compiled

ABREAST = 16  # distances compared at once


@dataclass(frozen=True)
class Neighbors:
    """Points to search for nearest neighbours, any frame, metres."""

    points: Array  # (n, 3)
    middle: Array  # (3,) mean of the points
    about: Singles  # (3, n) the points relative to `middle`, in single precision

    @classmethod
    def of(cls, points: Array) -> "Neighbors":
        """Return the search structure of `points` (n, 3)."""
        middle = points.mean(axis=0)
        return cls(points, middle, np.ascontiguousarray((points - middle).T, np.float32))

    def nearest(self, queries: Array) -> tuple[Array, Indices]:
        """Return distance (...) and index (...) of the point nearest to each of `queries` (..., 3).

        Among points equally near to within a micrometre, any may be returned.
        """
        rows = np.ascontiguousarray(queries).reshape(-1, 3)
        away, nearest = _nearest(self.points, self.about, self.middle, rows)
        return away.reshape(queries.shape[:-1]), nearest.reshape(queries.shape[:-1])


@compiled
def _nearest(points: Array, about: Singles, middle: Array, queries: Array) -> tuple[Array, Indices]:
    """Return distances and indices (q,); `about`: (3, n) points relative to `middle` (3,)."""
    away, nearest = np.empty(len(queries)), np.empty(len(queries), np.intp)
    squared = np.empty(about.shape[1], np.float32)
    # Floats that are not negative are ordered as the integers with the same bits, and the
    # minimum of integers is vectorised.
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
        nearest[q], total = _first(bits, least), 0.0
        for axis in range(3):
            total += (queries[q, axis] - points[nearest[q], axis]) ** 2
        away[q] = np.sqrt(total)
    return away, nearest


@compiled
def _first(bits: NDArray[np.int32], wanted: np.int32) -> int:
    """Return the first index at which `bits` (n,) equal `wanted`, which is among them."""
    found = 0
    while found + ABREAST <= len(bits):
        here = np.int32(0)
        for n in range(ABREAST):
            here |= np.int32(bits[found + n] == wanted)
        if here:
            break
        found += ABREAST
    while bits[found] != wanted:
        found += 1
    return found
