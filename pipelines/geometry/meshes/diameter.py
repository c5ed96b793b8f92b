"""Diameter of a point set: the largest distance between two of its points."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist

from pipelines.array_types import Array, Indices
from pipelines.geometry.directions import half_sphere_directions

MAX_EXACT, PAIR_ROWS = 8000, 500  # points with all pairs measured, and rows at a time
NUM_SUPPORTS = 2000  # directions 2.5 degrees apart
ROUNDING = 1e-9  # of a distance, relative
MAX_PRODUCTS = 4_000_000  # numbers in memory at a time


def diameter(points: Array) -> float:
    """Return the largest distance between two of `points` (n, 3), independent of rotation.

    The distance is exact, except for thousands of points at equal distance from the middle, as on a
    finely tessellated ball, where it is up to a thousandth too short.
    """
    try:
        corners = points[ConvexHull(points, qhull_options="QJ").vertices]
    except QhullError:  # fewer than four points, or all in one plane
        corners = points
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    out = np.linalg.norm(corners - middle, axis=1)
    # A point nearer to the middle than this cannot be part of a longer pair.
    known = _far_apart(corners, corners[out.argmax()])
    far = corners[out + out.max() >= (1.0 - ROUNDING) * known]
    if len(far) > MAX_EXACT:
        far = _outermost(far)
    rows = (cdist(far[i : i + PAIR_ROWS], far[i:]).max() for i in range(0, len(far), PAIR_ROWS))
    return float(max(rows))


def _far_apart(points: Array, start: Array) -> float:
    """Return the distance of a far pair, found by repeated steps to the farthest point."""
    longest = 0.0
    while True:
        apart = np.linalg.norm(points - start, axis=1)
        index = int(apart.argmax())
        if not apart[index] > longest:
            return longest
        longest, start = float(apart[index]), points[index]


def _outermost(points: Array) -> Array:
    """Return the `points` (n, 3) that are extreme along any of many directions.

    A lone tip is extreme over a wide angle and is kept; with every n-th point it could be lost.
    """
    directions = half_sphere_directions(NUM_SUPPORTS)
    found: list[Indices] = []
    for some in np.array_split(directions, max(1, len(points) * NUM_SUPPORTS // MAX_PRODUCTS)):
        along = some @ points.T
        found += [along.argmax(axis=1), along.argmin(axis=1)]
    return points[np.unique(np.concatenate(found))]
