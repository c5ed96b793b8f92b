"""Grasp rectangles as boxes with an orientation class, Multi-Grasp's representation.

The box is the rectangle turned to horizontal about its centre; its width is the gripper's opening.
Class c, from 1, is an opening line at -90 + 10 (c - 1) degrees, counter-clockwise on the screen.
The published network has a class 19 for +90 degrees, which equals class 1: no label has class 19,
and predictions of class 19 are read as class 1.
"""

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices
from pipelines.grasping.peers.rectangles import (
    RectColumn,
    angles,
    opening_pixels,
    rectangle_rows,
)

NUM_ORIENTATIONS = 18  # distinct orientations
CLASS_DEGREES = 10.0


def orientation_classes(rows: Array) -> NDArray[np.int64]:
    """Return the classes (n,), 1 to 18, of rectangles `rows` (n, 7)."""
    steps = np.rint((np.degrees(angles(rows)) + 90.0) / CLASS_DEGREES).astype(np.int64)
    return np.asarray(steps % NUM_ORIENTATIONS + 1)


def horizontal_boxes(rows: Array) -> Array:
    """Return boxes (n, 4) x0, y0, x1, y1 of rectangles `rows` (n, 7), turned to horizontal."""
    half = 0.5 * np.stack([opening_pixels(rows), rows[:, RectColumn.HEIGHT]], axis=1)
    center = rows[:, RectColumn.CENTER]
    return np.concatenate([center - half, center + half], axis=1)


def rows_of_boxes(boxes: Array, classes: NDArray[np.integer], score: Array) -> Array:
    """Return rectangles (n, 7) of `boxes` (n, 4) with `classes` (n,) and `score` (n,)."""
    angle = np.radians(CLASS_DEGREES * (classes - 1) - 90.0)
    size = boxes[:, 2:] - boxes[:, :2]
    center = 0.5 * (boxes[:, 2:] + boxes[:, :2])
    return rectangle_rows(center, angle, size[:, 0], size[:, 1], score)


def spread_rows(rows: Array, most: int) -> Indices:
    """Return indices of `rows` (n, 7) to keep: up to `most` per object, far from each other.

    Distances are in pixels between centres; a turn by 30 degrees counts as a rectangle's height.
    """
    kept: list[Indices] = []
    double = 2.0 * angles(rows)
    around = np.stack([np.cos(double), np.sin(double)], axis=1)
    turn = rows[:, RectColumn.HEIGHT, None] / np.radians(60.0) * around
    places = np.concatenate([rows[:, RectColumn.CENTER], turn], axis=1)
    owners = rows[:, RectColumn.OBJECT_ID]
    for object_id in np.unique(owners):
        own = np.flatnonzero(owners == object_id)
        kept.append(own[_farthest_first(places[own], most)])
    return np.sort(np.concatenate([np.zeros(0, np.int64), *kept]))


def _farthest_first(places: Array, most: int) -> Indices:
    """Return indices of up to `most` `places` (n, d), each the farthest from the earlier ones."""
    chosen = [0]
    nearest = np.linalg.norm(places - places[0], axis=1)
    while len(chosen) < min(most, len(places)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return np.array(chosen, np.int64)
