"""Affordance of a surface: how well the object can be held with one finger there (D. 9)."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from pipelines.array_types import Array

NUM_LEVELS = 64  # more distinct qualities than this are rounded down to as many


def point_affordance(
    points: ArrayLike, contacts: ArrayLike, quality: ArrayLike, radius: float
) -> Array:
    """Return (n,) the best quality of the pairs with one contact within `radius` of each point.

    Points that no contact reaches get 0.

    Args:
        points: (n, 3) metres.
        contacts: (m, 2, 3) metres, contact pairs, same frame.
        quality: (m,) 1 - smallest friction coefficient, 0 to 1.
        radius: metres.
    """
    where = np.asarray(points, np.float64).reshape(-1, 3)
    pairs = np.asarray(contacts, np.float64).reshape(-1, 2, 3)
    levels = np.asarray(quality, np.float64)
    if len(np.unique(levels)) > NUM_LEVELS:
        levels = np.floor(levels * NUM_LEVELS) / NUM_LEVELS
    affordance = np.zeros(len(where))
    open_points = np.arange(len(where))
    # From the best quality down, each point takes the first level that reaches it.
    for level in np.unique(levels)[::-1]:
        if level <= 0.0 or not len(open_points):
            break
        tree = KDTree(pairs[levels == level].reshape(-1, 3))
        reach = tree.query(where[open_points], distance_upper_bound=radius)[0]
        reached = np.isfinite(reach)
        affordance[open_points[reached]] = level
        open_points = open_points[~reached]
    return affordance
