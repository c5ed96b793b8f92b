"""Dense symmetry error: mean distance of the images of points under two symmetries.

The distance is relative to the longest displacement under the true symmetry. The error needs no
choice of plane origin or axis sign, and counts only the deviation at the object itself.
"""

import numpy as np

from pipelines.array_types import Array
from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)

TURNS = tuple(np.pi * k / 8 for k in range(1, 16))  # radians


def symmetry_error(points: Array, predicted: Symmetry, truth: Symmetry) -> float:
    """Return the dense error of two symmetries of one kind; for spheres, the distance in metres.

    For planes: mean |S_pred(x) - S_true(x)| / max |S_true(x) - x|, dimensionless; for axes: the
    mean of this error over rotations by `TURNS`. `points`: (n, 3) metres, a common frame, n >= 1.

    Raises:
        ValueRangeError: the kinds differ, so their maps cannot be compared.
    """
    match predicted, truth:
        case ReflectionSymmetry(), ReflectionSymmetry():
            images = predicted.counterpart(points), truth.counterpart(points)
            return _displacement_ratio(points, *images)
        case RotationSymmetry(), RotationSymmetry():
            # An axis has no sign: the predicted axis is turned toward the true one.
            sign = 1.0 if float(predicted.axis @ truth.axis) >= 0.0 else -1.0
            turns = [(predicted.turn(points, sign * a), truth.turn(points, a)) for a in TURNS]
            return float(np.mean([_displacement_ratio(points, *images) for images in turns]))
        case SphereSymmetry(), SphereSymmetry():
            return float(np.linalg.norm(predicted.point - truth.point))
    raise ValueRangeError("predicted symmetry", predicted.kind, f"a {truth.kind} like the truth")


def _displacement_ratio(points: Array, predicted: Array, truth: Array) -> float:
    reach = float(np.linalg.norm(truth - points, axis=1).max())
    miss = float(np.linalg.norm(predicted - truth, axis=1).mean())
    if reach == 0.0:  # all points are on the true plane or axis: only equal images are right
        return 0.0 if miss == 0.0 else float("inf")
    return miss / reach
