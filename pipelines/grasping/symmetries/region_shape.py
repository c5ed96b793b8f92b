"""Directions and extents of a region's shape, from which symmetries are proposed.

The axes of a box follow from its largest face and its outline, the level directions of any object
on a table from its outline as seen from above.
"""

import cv2
import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import basis_from_direction, cross, unit

ENDS = (0.015, 0.985)  # of the points along a direction, against flying pixels
TOP = 0.97  # of a region's heights, against flying pixels
FACE_TRIALS = 40  # normals tried for the largest face
FACE_ANGLE = np.radians(20.0)  # closer normals belong to one face
SIDE_ANGLE = np.radians(30.0)  # largest angle of a side's normal to the plane of the largest face
MIN_SIDE_POINTS = 10


def half_between_ends(points: Array, directions: Array) -> Array:
    """Return the offsets (k,) along `directions` (k, 3) halfway between the ends of `points`."""
    return np.asarray(quantiles(directions @ points.T, ENDS).mean(axis=1))


def halfway_up(points: Array, table: Plane) -> Array:
    """Return a point (3,) halfway between the table and the top of `points` (n, 3)."""
    foot = median(points.T)
    rise = region_top(points, table) / 2.0 - float(table.height(foot))
    return np.asarray(foot + rise * table.normal)


def region_top(points: Array, table: Plane) -> float:
    """Return the height in metres of the top of `points` (n, 3) above `table`."""
    return float(quantiles(table.height(points), TOP))


def face_directions(points: Array, normals: Array) -> list[Array]:
    """Return edges (3,) of two fitting boxes: the largest face's normal, and directions across.

    Two directions follow from the outline, two from the other faces, if any are seen. `points`:
    (n, 3) metres. `normals`: (n, 3) unit.
    """
    face = largest_face(normals)
    basis = basis_from_direction(face)[:, 1:]
    lean = normals @ basis
    sides = lean[np.linalg.norm(lean, axis=1) > np.sin(np.pi / 2 - SIDE_ANGLE)]
    angles = [_outline_angle(points @ basis)]
    if len(sides) > MIN_SIDE_POINTS:
        # Four times their angle is equal for faces at right angles.
        quadrupled = 4.0 * np.arctan2(sides[:, 1], sides[:, 0])
        angles.append(float(np.angle(np.exp(1j * quadrupled).mean())) / 4.0)
    return [face, *_frames(face, basis, angles)]


def largest_face(normals: Array) -> Array:
    """Return the normal (3,) that most of `normals` (n, 3) are parallel or opposite to."""
    trials = strided_at_least(normals, FACE_TRIALS)
    narrow = np.cos(FACE_ANGLE)
    face = trials[_likeness(np.abs(normals @ trials.T), float(narrow)).argmax()]
    cosine = normals @ face
    near = np.abs(cosine) > narrow
    return unit((normals[near] * np.sign(cosine[near])[:, None]).sum(axis=0))


def level_directions(points: Array, table: Plane) -> list[Array]:
    """Return the sides of the smallest rectangle around `points` (n, 3) as seen from above.

    Also the principal axes in the table's plane, in case the far side of the outline is unseen.
    """
    basis = basis_from_direction(table.normal)[:, 1:]
    flat = points @ basis
    longest = axes_of_spread(flat)[:, 1]
    angles = [_outline_angle(flat), float(np.arctan2(longest[1], longest[0]))]
    return _frames(table.normal, basis, angles)


def axes_of_spread(points: Array) -> Array:
    """Return the principal axes (d, d) of `points` (n, d) as columns, longest last."""
    away = points - points.mean(axis=0)
    vectors: Array = np.linalg.eigh(away.T @ away / (len(points) - 1))[1]
    return vectors


def _frames(normal: Array, basis: Array, angles: list[float]) -> list[Array]:
    """Return two directions (3,) for each of `angles` in `basis` (3, 2): at it, and across."""
    first = np.array([[np.cos(angle), np.sin(angle)] for angle in angles]) @ basis.T
    across = cross(normal, first)
    return [each for pair in zip(first, across, strict=True) for each in pair]


def _outline_angle(flat: Array) -> float:
    """Return the angle of the smallest rectangle around `flat` (n, 2), radians."""
    return float(np.radians(cv2.minAreaRect(flat.astype(np.float32))[2]))


@compiled
def _likeness(cosine: Array, narrow: float) -> Array:
    """Return sums (t,) over n of `cosine` (n, t), scaled to 0 at `narrow` or less, 1 at 1."""
    total = np.zeros(cosine.shape[1])
    for n in range(len(cosine)):
        for t in range(len(total)):
            total[t] += min(max((cosine[n, t] - narrow) / (1.0 - narrow), 0.0), 1.0)
    return total
