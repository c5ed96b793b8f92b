"""Dense symmetry error: mean distance of the images of points under two symmetries.

The distance is relative to the longest displacement under the true symmetry. The error needs no
choice of plane origin or axis sign, and counts only the deviation at the object itself.
"""

from collections.abc import Sequence

import numpy as np

from pipelines.array_types import Array
from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)

TURNS = tuple(np.pi * k / 8 for k in range(1, 16))


def reflection_error(
    points: Array, predicted: ReflectionSymmetry, truth: ReflectionSymmetry
) -> float:
    """Return mean |S_pred(x) - S_true(x)| / max |S_true(x) - x|, dimensionless.

    `points`: (n, 3) metres, any frame that both symmetries share, n >= 1.
    """
    return _displacement_ratio(points, predicted.counterpart(points), truth.counterpart(points))


def rotation_error(
    points: Array,
    predicted: RotationSymmetry,
    truth: RotationSymmetry,
    angles: Sequence[float] = TURNS,
) -> float:
    """Return the error of `reflection_error` for turns, averaged over `angles` (radians).

    Half a turn alone is the variant of SymmetryNet's released evaluation. An axis has no sign: the
    predicted axis is taken in the direction closer to the true axis.
    `points`: (n, 3) metres, any frame that both symmetries share, n >= 1.
    """
    sign = 1.0 if float(predicted.axis @ truth.axis) >= 0.0 else -1.0
    ratios = [
        _displacement_ratio(points, predicted.turn(points, sign * a), truth.turn(points, a))
        for a in angles
    ]
    return float(np.mean(ratios))


def sphere_distance(predicted: SphereSymmetry, truth: SphereSymmetry) -> float:
    """Return the distance of the two centres in metres."""
    return float(np.linalg.norm(predicted.point - truth.point))


def symmetry_error(points: Array, predicted: Symmetry, truth: Symmetry) -> float:
    """Return the dense error of two symmetries of one kind; for spheres the distance in metres.

    Raises `ValueRangeError` when the kinds differ, because their maps cannot be compared.
    """
    if isinstance(predicted, ReflectionSymmetry) and isinstance(truth, ReflectionSymmetry):
        return reflection_error(points, predicted, truth)
    if isinstance(predicted, RotationSymmetry) and isinstance(truth, RotationSymmetry):
        return rotation_error(points, predicted, truth)
    if isinstance(predicted, SphereSymmetry) and isinstance(truth, SphereSymmetry):
        return sphere_distance(predicted, truth)
    raise ValueRangeError("predicted symmetry", predicted.kind, f"a {truth.kind} like the truth")


def _displacement_ratio(points: Array, predicted: Array, truth: Array) -> float:
    reach = float(np.linalg.norm(truth - points, axis=1).max())
    miss = float(np.linalg.norm(predicted - truth, axis=1).mean())
    if reach == 0.0:  # every point lies on the true plane or axis: only equal images are right
        return 0.0 if miss == 0.0 else float("inf")
    return miss / reach
