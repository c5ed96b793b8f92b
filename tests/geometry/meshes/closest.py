"""Closest points on triangles, by the loop of the signed-distance grids."""

import numpy as np

from pipelines.geometry.meshes.signed_distance import _closest


def closest_points(triangles, points):
    """Return (n, 3): the point of each of `triangles` (n, 3, 3) closest to `points` (n, 3)."""
    pairs = zip(triangles.tolist(), points.tolist(), strict=True)
    return np.array([_closest(*map(tuple, corners), tuple(point)) for corners, point in pairs])
