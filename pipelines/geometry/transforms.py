"""Rigid transforms, and the conventions of the toolkit.

Metres, radians, float64. A transform is a (4, 4) matrix; `T_cam_obj` maps object coordinates to
camera coordinates, so `T_world_obj = T_world_cam @ T_cam_obj`. The camera has OpenCV axes: x right,
y down, z forward. An array that could be in two frames carries a suffix: `points_cam`,
`points_obj`.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array
from pipelines.geometry.numerics.compiled import compiled


def make_pose(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """Return the (..., 4, 4) transform of `rotation` (..., 3, 3) and `translation` (..., 3)."""
    R, t = np.asarray(rotation, np.float64), np.asarray(translation, np.float64)
    pose = np.zeros((*np.broadcast_shapes(R.shape[:-2], t.shape[:-1]), 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = R, t, 1.0
    return pose


def invert(T: ArrayLike) -> Array:
    """Return the inverses (..., 4, 4) of rigid transforms `T` (..., 4, 4)."""
    T = np.asarray(T, np.float64)
    R_inverse = np.swapaxes(T[..., :3, :3], -1, -2)
    return make_pose(R_inverse, -np.einsum("...ij,...j->...i", R_inverse, T[..., :3, 3]))


def transform_points(T: ArrayLike, points: ArrayLike) -> Array:
    """Return `points` (..., 3) moved by one transform `T` (4, 4)."""
    T = np.asarray(T, np.float64)
    return np.asarray(np.asarray(points, np.float64) @ T[:3, :3].T + T[:3, 3])


def rotate_vectors(T: ArrayLike, vectors: ArrayLike) -> Array:
    """Return `vectors` (..., 3) turned by `T`, a matrix (3, 3) or the one of a transform (4, 4)."""
    return np.asarray(vectors, np.float64) @ np.asarray(T, np.float64)[:3, :3].T


def unit(vectors: ArrayLike) -> Array:
    """Return `vectors` (..., d) scaled to length one; zero vectors stay zero."""
    v = np.ascontiguousarray(vectors, np.float64)
    return _units(v.reshape(-1, v.shape[-1])).reshape(v.shape)


def cross(first: Array, second: Array) -> Array:
    """Return the cross products (..., 3) of the vectors `first` and `second` (..., 3).

    Equal to `np.cross`, and much faster for few vectors.
    """
    x, y, z = first[..., 0], first[..., 1], first[..., 2]
    u, v, w = second[..., 0], second[..., 1], second[..., 2]
    product = np.empty(np.broadcast_shapes(first.shape, second.shape))
    product[..., 0] = y * w - z * v
    product[..., 1] = z * u - x * w
    product[..., 2] = x * v - y * u
    return product


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Return rotations (..., 3, 3) by `angle` (...) about the unit vectors `axis` (..., 3)."""
    u, angle = unit(axis), np.asarray(angle, np.float64)
    by_axis = np.zeros((*u.shape, 3))  # matrix of the cross product with the axis
    by_axis[..., 2, 1], by_axis[..., 0, 2], by_axis[..., 1, 0] = u[..., 0], u[..., 1], u[..., 2]
    by_axis -= np.swapaxes(by_axis, -1, -2)
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.asarray(np.eye(3) + s * by_axis + (1.0 - c) * (by_axis @ by_axis))  # Rodrigues


def random_rotation(rng: np.random.Generator) -> Array:
    """Return a (3, 3) rotation, uniform over all rotations."""
    return quaternion_to_matrix(rng.normal(size=4))


def nearest_orthogonal(matrices: ArrayLike) -> Array:
    """Return the orthogonal matrices (..., 3, 3) nearest to finite `matrices` (..., 3, 3).

    The determinant of the result keeps the sign of the matrix: -1 for mirrored frames.
    """
    u, _, v = np.linalg.svd(np.asarray(matrices, np.float64))
    return np.asarray(u @ v)


def basis_from_direction(direction: ArrayLike) -> Array:
    """Return right-handed bases (..., 3, 3) whose first column is `direction` (..., 3)."""
    d = np.ascontiguousarray(direction, np.float64)
    return _bases(_units(d.reshape(-1, 3))).reshape(*d.shape, 3)


def quaternion_to_matrix(wxyz: ArrayLike) -> Array:
    """Return rotations (..., 3, 3) of quaternions (..., 4), w first, of any length but zero."""
    w, x, y, z = np.moveaxis(unit(wxyz), -1, 0)
    rows = [
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
    ]
    return np.stack(rows, -2)


def matrix_to_quaternion(rotation: ArrayLike) -> Array:
    """Return the quaternions (..., 4), w first and not negative, of rotations (..., 3, 3)."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import

    R = np.asarray(rotation, np.float64)
    xyzw = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat()
    wxyz = xyzw[:, [3, 0, 1, 2]] * np.where(xyzw[:, 3:] < 0, -1.0, 1.0)
    return np.asarray(wxyz.reshape(*R.shape[:-2], 4))


@compiled
def _units(vectors: Array) -> Array:
    """Return `vectors` (n, d) scaled to length one; zero vectors stay zero."""
    units = np.empty_like(vectors)
    for n in range(len(vectors)):
        total = 0.0
        for i in range(vectors.shape[1]):
            total += vectors[n, i] * vectors[n, i]
        length = np.sqrt(total) if total > 0 else 1.0
        for i in range(vectors.shape[1]):
            units[n, i] = vectors[n, i] / length
    return units


@compiled
def _bases(units: Array) -> Array:
    """Return right-handed bases (n, 3, 3) whose first columns are `units` (n, 3)."""
    bases = np.empty((len(units), 3, 3))
    for n in range(len(units)):
        x, y, z = units[n, 0], units[n, 1], units[n, 2]
        # The cross product with the coordinate axis farthest from the direction never vanishes.
        u, v, w = 0.0, -z, y
        if abs(y) < abs(x) and abs(y) <= abs(z):
            u, v, w = z, 0.0, -x
        elif abs(z) < abs(x) and abs(z) < abs(y):
            u, v, w = -y, x, 0.0
        length = np.sqrt(u * u + v * v + w * w)
        if length > 0:
            u, v, w = u / length, v / length, w / length
        bases[n, 0, 0], bases[n, 1, 0], bases[n, 2, 0] = x, y, z
        bases[n, 0, 1], bases[n, 1, 1], bases[n, 2, 1] = u, v, w
        bases[n, 0, 2] = y * w - z * v
        bases[n, 1, 2] = z * u - x * w
        bases[n, 2, 2] = x * v - y * u
    return bases
