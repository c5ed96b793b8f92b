"""Normal equations of symmetry fits: sums over the points of a surface, as compiled loops.

Each residual r, in metres, has a weight w (Tukey's biweight at a scale) and derivatives J by the
four unknowns of `symmetry_fitting`: two turns of a direction along its basis (3, 2), two offsets.
"""

import numpy as np

from pipelines.array_types import Array, Indices, Vector
from pipelines.geometry.numerics.compiled import compiled

Derivatives = tuple[float, float, float, float]
Sums = tuple[Array, Array, Array]  # of w J J^T (k, 4, 4), w J r (k, 4) and w (k,), for k starts

SCALES = (0.020, 0.004)  # metres, Tukey's biweight at the first and at the last step
REACH = SCALES[0] / 2 + SCALES[0]  # metres from a mirror image to its nearest surface point
MIN_SLOPE = 0.2  # sine between normal and axis; flat ends of a body hardly determine its axis
MATCH_NORMAL = np.cos(np.radians(40.0))  # between the normals of an image and of its nearest point


@compiled
def _row(rows: Array, n: int) -> Vector:
    """Return a row (3,) as three floats, which are faster than a view of the array."""
    return rows[n, 0], rows[n, 1], rows[n, 2]


@compiled
def _column(bases: Array, k: int, column: int) -> Vector:
    """Return a column (3,) of the k-th of `bases` (k, 3, c)."""
    return bases[k, 0, column], bases[k, 1, column], bases[k, 2, column]


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
def _biweight(residual: float, scale: float) -> float:
    return (1.0 - (residual / scale) ** 2) ** 2 if abs(residual) < scale else 0.0


def axis_sums(
    rows: Array,  # (n, 6) points x normals, and normals, metres
    squares: Array,  # (n, 36) outer products of the rows with themselves
    axis: Array,  # (k, 3) unit vectors
    center: Array,  # (k, 3) a point of each axis, metres
    basis: Array,  # (k, 3, 2) directions across the start axes
    scale: float,  # Tukey's scale, metres
) -> Sums:
    """Return the sums of k axes; a residual is the distance of a normal's line from the axis."""
    forms = _axis_forms(axis, center, basis)
    weight, total = _axis_weights(forms[:, 0] @ rows.T, axis @ rows[:, 3:].T, scale)
    # Residuals and derivatives are linear in the rows, so their sums are linear in the squares.
    moment = (weight @ squares).reshape(-1, 6, 6)
    sums = forms @ moment @ forms.swapaxes(1, 2)
    return sums[:, 1:, 1:].copy(), sums[:, 1:, 0].copy(), total


@compiled
def _axis_forms(axis: Array, center: Array, basis: Array) -> Array:
    """Return forms (k, 5, 6) that map a row to sine times residual, and to its derivatives."""
    forms = np.zeros((len(axis), 5, 6))
    for k in range(len(axis)):
        along, c = _row(axis, k), _row(center, k)
        sides = _column(basis, k, 0), _column(basis, k, 1)
        # (n x v) . (p - c) = v . (p x n) - n . (v x c)
        arm = _cross(along, c)
        for i in range(3):
            forms[k, 0, i], forms[k, 0, 3 + i] = along[i], -arm[i]
        for side in range(2):
            arm, aside = _cross(sides[side], c), _cross(along, sides[side])
            for i in range(3):
                forms[k, 1 + side, i], forms[k, 1 + side, 3 + i] = sides[side][i], -arm[i]
                forms[k, 3 + side, 3 + i] = -aside[i]
    return forms


@compiled
def _axis_weights(passing: Array, along: Array, scale: float) -> tuple[Array, Array]:
    """Return the weights over squared sines (k, n), and the sums of the weights (k,).

    `passing`: (k, n) sine times distance of a normal's line from the axis, metres; `along`: cosine.
    """
    weight, total = np.empty(passing.shape), np.zeros(len(passing))
    for k in range(len(passing)):
        for n in range(passing.shape[1]):
            square = max(1.0 - along[k, n] * along[k, n], MIN_SLOPE * MIN_SLOPE)
            near = max(1.0 - passing[k, n] * passing[k, n] / (square * scale * scale), 0.0)
            weight[k, n] = near * near / square
            total[k] += near * near
    return weight, total


@compiled
def _add(sums: Sums, k: int, row: Derivatives, residual: float, weight: float) -> None:
    """Add a residual with derivatives `row` to the sums of the k-th start."""
    for i in range(4):
        sums[1][k, i] += weight * row[i] * residual
        for j in range(4):
            sums[0][k, i, j] += weight * row[i] * row[j]
    sums[2][k] += weight


@compiled
def mirror_images(points: Array, normal: Array, point: Array) -> Array:
    """Return the images (k, n, 3) of `points` (n, 3) in planes of `normal` and `point` (k, 3)."""
    images = np.empty((len(normal), len(points), 3))
    for k in range(len(normal)):
        m, at = _row(normal, k), _row(point, k)
        for n in range(len(points)):
            height = _dot(m, _minus(_row(points, n), at))
            for i in range(3):
                images[k, n, i] = points[n, i] - 2.0 * height * m[i]
    return images


@compiled
def plane_sums(
    points: Array,  # (m, 3) surface points, metres
    normals: Array,  # (m, 3) their normals
    stride: int,  # every `stride`-th point is mirrored, n points in all
    images: Array,  # (k, n, 3) mirror images of these points
    away: Array,  # (k, n) metres from each image to the nearest surface point
    nearest: Indices,  # (k, n) index of that surface point
    normal: Array,  # (k, 3) unit normals of the planes
    point: Array,  # (k, 3) a point of each plane
    basis: Array,  # (k, 3, 2) directions across the start normals
    scale: float,  # Tukey's scale, metres
) -> Sums:
    """Return the sums of k planes; a residual is the distance of an image from the surface."""
    size = len(normal)
    sums = np.zeros((size, 4, 4)), np.zeros((size, 4)), np.zeros(size)
    for k in range(size):
        m, first, second = _row(normal, k), _column(basis, k, 0), _column(basis, k, 1)
        for n in range(images.shape[1]):
            image = images[k, n, 0], images[k, n, 1], images[k, n, 2]
            v, own = _row(normals, nearest[k, n]), _row(normals, n * stride)
            along = _dot(m, v)
            residual = _dot(v, _minus(image, _row(points, nearest[k, n])))
            weight = _biweight(residual, scale)
            # An image next to the seen surface has its nearest point on the surface's border,
            # which does not constrain the plane.
            beside = away[k, n] > REACH or away[k, n] - abs(residual) > SCALES[0] / 2
            alike = _dot(own, v) - 2.0 * _dot(m, own) * along > MATCH_NORMAL
            if weight > 0.0 and alike and not beside:
                foot = _minus(_row(points, n * stride), _row(point, k))
                height = _dot(m, foot)
                row = (
                    -2.0 * (_dot(foot, first) * along + height * _dot(v, first)),
                    -2.0 * (_dot(foot, second) * along + height * _dot(v, second)),
                    2.0 * along,
                    0.0,
                )
                _add(sums, k, row, residual, weight)
    return sums


def stepped(
    starts: tuple[Array, Array, Array],  # unit directions, points (k, 3), bases (k, 3, 2) across
    offsets: Array,  # (k, 3, 2) directions along which the points move
    total: Array,  # (k, 4) unknowns before the step
    sums: Sums,  # sums over the residuals
    share: float,  # factor of the sums
    precision: Array,  # (4,) precisions of the unknowns' priors, whose means are zero
) -> tuple[Array, Array, Array]:
    """Return unknowns (k, 4), directions (k, 3) and points (k, 3) after a Gauss-Newton step."""
    # numba takes two seconds to compile a solver; numpy's gives the same numbers.
    right = share * sums[1] + precision * total
    step = np.linalg.solve(share * sums[0] + np.diag(precision), right[..., None])[..., 0]
    return _moved(starts, offsets, total - step)


@compiled
def _moved(
    starts: tuple[Array, Array, Array], offsets: Array, found: Array
) -> tuple[Array, Array, Array]:
    """Return `found`, and the directions and points that these unknowns (k, 4) make of `starts`."""
    directions, points, basis = starts
    point, direction = np.empty_like(points), np.empty_like(points)
    for k in range(len(found)):
        length = 0.0
        for i in range(3):
            turn = basis[k, i, 0] * found[k, 0] + basis[k, i, 1] * found[k, 1]
            move = offsets[k, i, 0] * found[k, 2] + offsets[k, i, 1] * found[k, 3]
            direction[k, i], point[k, i] = directions[k, i] + turn, points[k, i] + move
            length += direction[k, i] ** 2
        for i in range(3):
            direction[k, i] /= np.sqrt(length)
    return found, direction, point


def fitted_sphere(
    points: Array,  # (n, 3) surface points, metres
    normals: Array,  # (n, 3) their normals
    start: Array,  # (3,) centre of the prior
    scales: Array,  # (s,) Tukey's scale of each step, metres
    share: float,  # factor of the sums over the points
    precision: float,  # of the prior
) -> tuple[Array, float]:
    """Return the centre (3,) nearest to the lines of n normals, and the sum of weights.

    A point farther than a scale from the median radius has weight 0.
    """
    center, total = start, 0.0
    for scale in scales.tolist():
        distance = _distances(points, center)
        radius = float(np.median(distance))
        spread, pull = precision * np.eye(3), precision * (start - center)
        total = _add_lines(points, normals, center, distance, (radius, scale, share), spread, pull)
        center = center + np.linalg.solve(spread, pull)
    return center, total


@compiled
def _distances(points: Array, center: Array) -> Array:
    """Return the distance (n,) of each of `points` (n, 3) from `center` (3,)."""
    distance, middle = np.empty(len(points)), (center[0], center[1], center[2])
    for n in range(len(points)):
        foot = _minus(_row(points, n), middle)
        distance[n] = np.sqrt(_dot(foot, foot))
    return distance


@compiled
def _add_lines(
    points: Array,
    normals: Array,
    center: Array,
    distance: Array,  # (n,) of the points from the centre
    scales: Vector,  # radius, Tukey's scale, and the factor of the sums
    spread: Array,  # (3, 3) the matrix of the step, added to
    pull: Array,  # (3,) its right side, added to
) -> float:
    """Add the lines of n normals to the equations of a centre's step; return the weights' sum."""
    (radius, scale, share), total = scales, 0.0
    middle = center[0], center[1], center[2]
    for n in range(len(points)):
        if abs(distance[n] - radius) < scale:
            foot, normal = _minus(_row(points, n), middle), _row(normals, n)
            height = _dot(foot, normal)
            passing = _minus(foot, (height * normal[0], height * normal[1], height * normal[2]))
            weight = _biweight(np.sqrt(_dot(passing, passing)), scale)
            total += weight
            for i in range(3):
                pull[i] += share * weight * passing[i]
                spread[i, i] += share * weight
                for j in range(3):
                    spread[i, j] -= share * weight * normal[i] * normal[j]
    return total
