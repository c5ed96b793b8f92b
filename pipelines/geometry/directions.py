"""Directions spread evenly over the sphere, on Fibonacci's spiral."""

import numpy as np

from pipelines.array_types import Array

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))  # radians


def sphere_directions(count: int, step: float = GOLDEN_ANGLE, first: float = 0.0) -> Array:
    """Return (count, 3) unit vectors, evenly spread over the sphere, from the top down.

    `step`: radians about z from each to the next, the golden angle or its negative. `first`: steps
    from x to the first.
    """
    index = np.arange(count, dtype=np.float64)
    return _at(1.0 - (2.0 * index + 1.0) / count, step * (index + first))


def half_sphere_directions(count: int) -> Array:
    """Return (count, 3) unit vectors, evenly spread over the half-sphere z >= 0."""
    index = np.arange(count, dtype=np.float64)
    # The order of the products decides the last bits of symmetry annotations.
    return _at((index + 0.5) / count, index * np.pi * (3.0 - np.sqrt(5.0)))


def _at(z: Array, turn: Array) -> Array:
    """Return the unit vectors (n, 3) of height `z` (n,), `turn` (n,) radians about z from x."""
    radius = np.sqrt(1.0 - z**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
