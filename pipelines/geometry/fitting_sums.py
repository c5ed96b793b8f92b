"""What the surface says of candidate symmetries, summed over its points: the loops of a fit.

Each residual r, in metres, has a weight w (Tukey's biweight at a scale) and derivatives J by the
four unknowns of `symmetry_fitting`: two turns of a direction along its basis (3, 2), two offsets.
"""

import numpy as np
from numpy.typing import NDArray

from pipelines.geometry.compiled import compiled

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Derivatives = tuple[float, float, float, float]
Sums = tuple[Array, Array, Array]  # of w J J^T (k, 4, 4), w J r (k, 4) and w (k,), for each start

SCALES = (0.020, 0.004)  # metres, Tukey's biweight at the first and at the last step
REACH = SCALES[0] / 2 + SCALES[0]  # metres from an image to what it may meet
MIN_SLOPE = 0.2  # sine between normal and axis; flatter ends say little about the axis
MATCH_NORMAL = np.cos(np.radians(40.0))


@compiled
def _biweight(residual: float, scale: float) -> float:
    return (1.0 - (residual / scale) ** 2) ** 2 if abs(residual) < scale else 0.0


@compiled
def _row(rows: Array, n: int) -> Vector:
    """Return a row (3,) as numbers: views of rows would cost more than what is done with them."""
    return rows[n, 0], rows[n, 1], rows[n, 2]


@compiled
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def _cross(a: Vector, b: Vector) -> Vector:
    x, y, z = a
    u, v, w = b
    return y * w - z * v, z * u - x * w, x * v - y * u


@compiled
def _add(sums: Sums, k: int, row: Derivatives, residual: float, weight: float) -> None:
    """Add a residual with derivatives `row` to what is known of the k-th start."""
    for i in range(4):
        sums[1][k, i] += weight * row[i] * residual
        for j in range(4):
            sums[0][k, i, j] += weight * row[i] * row[j]
    sums[2][k] += weight


@compiled
def axis_sums(
    moments: Array, normals: Array, axis: Array, centre: Array, basis: Array, scale: float
) -> Sums:
    """Return the sums for k axes: how far the lines of n normals pass by each, over their sine.

    Args:
        moments: (n, 3) points x normals.
        normals: (n, 3).
        axis: (k, 3) unit.
        centre: (k, 3) a point of each, metres.
        basis: (k, 3, 2) across the axes that were started from.
        scale: metres.
    """
    size = len(axis)
    sums = np.zeros((size, 4, 4)), np.zeros((size, 4)), np.zeros(size)
    for k in range(size):
        along, c = _row(axis, k), _row(centre, k)
        first, second = _row(basis[k].T, 0), _row(basis[k].T, 1)
        arms = _cross(along, c), _cross(first, c), _cross(second, c)
        aside = _cross(along, first), _cross(along, second)
        for n in range(len(normals)):
            moment, normal = _row(moments, n), _row(normals, n)
            sine = np.sqrt(max(1.0 - _dot(along, normal) ** 2, MIN_SLOPE**2))
            # (n x v) . (p - c) = v . (p x n) - n . (v x c)
            residual = (_dot(along, moment) - _dot(normal, arms[0])) / sine
            weight = _biweight(residual, scale)
            if weight > 0.0:
                row = (
                    (_dot(first, moment) - _dot(normal, arms[1])) / sine,
                    (_dot(second, moment) - _dot(normal, arms[2])) / sine,
                    -_dot(aside[0], normal) / sine,
                    -_dot(aside[1], normal) / sine,
                )
                _add(sums, k, row, residual, weight)
    return sums


@compiled
def plane_sums(
    moved: Array,
    facing: Array,
    images: Array,
    away: Array,
    met: Array,
    target: Array,
    normal: Array,
    point: Array,
    basis: Array,
    scale: float,
) -> Sums:
    """Return the sums for k planes: how far images lie off the surface, along its normals.

    Args:
        moved: (n, 3) the mirrored points, metres.
        facing: (n, 3) their normals.
        images: (k, n, 3) of them.
        away: (k, n) metres from these to the nearest points of the surface.
        met: (k, n, 3) the nearest points.
        target: (k, n, 3) the normals there.
        normal: (k, 3) of the planes.
        point: (k, 3) on them.
        basis: (k, 3, 2) across the normals that were started from.
        scale: metres.
    """
    size = len(normal)
    sums = np.zeros((size, 4, 4)), np.zeros((size, 4)), np.zeros(size)
    for k in range(size):
        m, first, second = _row(normal, k), _row(basis[k].T, 0), _row(basis[k].T, 1)
        for n in range(len(moved)):
            v, own = _row(target[k], n), _row(facing, n)
            along = _dot(m, v)
            residual = _dot(v, _minus(_row(images[k], n), _row(met[k], n)))
            weight = _biweight(residual, scale)
            # An image beside the seen surface meets its border: that says nothing of the plane,
            # whether it is farther off or misses the surface by more than a scale.
            beside = away[k, n] > REACH or away[k, n] - abs(residual) > SCALES[0] / 2
            alike = _dot(own, v) - 2.0 * _dot(m, own) * along > MATCH_NORMAL
            if weight > 0.0 and alike and not beside:
                foot = _minus(_row(moved, n), _row(point, k))
                height = _dot(m, foot)
                row = (
                    -2.0 * (_dot(foot, first) * along + height * _dot(v, first)),
                    -2.0 * (_dot(foot, second) * along + height * _dot(v, second)),
                    2.0 * along,
                    0.0,
                )
                _add(sums, k, row, residual, weight)
    return sums


@compiled
def sphere_sums(
    points: Array, normals: Array, centre: Array, scale: float
) -> tuple[Array, Array, float]:
    """Return sums over n points for a `centre` (3,): how far their normals' lines pass by it.

    Of w (1 - v v^T) (3, 3), v the normal; of w times the way to the line (3,); of w. A point that
    lies farther than `scale` metres off the median radius has no weight.
    """
    distance, middle = np.empty(len(points)), (centre[0], centre[1], centre[2])
    for n in range(len(points)):
        foot = _minus(_row(points, n), middle)
        distance[n] = np.sqrt(_dot(foot, foot))
    radius = np.median(distance)
    spread, pull, total = np.zeros((3, 3)), np.zeros(3), 0.0
    for n in range(len(points)):
        foot, normal = _minus(_row(points, n), middle), _row(normals, n)
        height = _dot(foot, normal)
        passing = (height * normal[0], height * normal[1], height * normal[2])
        passing = _minus(foot, passing)
        weight = _biweight(np.sqrt(_dot(passing, passing)), scale)
        if weight > 0.0 and abs(distance[n] - radius) < scale:
            total += weight
            for i in range(3):
                pull[i] += weight * passing[i]
                spread[i, i] += weight
                for j in range(3):
                    spread[i, j] -= weight * normal[i] * normal[j]
    return spread, pull, total
