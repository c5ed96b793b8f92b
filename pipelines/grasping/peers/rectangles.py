"""Grasp rectangles in the image, as in GraspNet-1Billion's planar labels, and their poses.

A row (7,) holds the rectangle's centre, the middle of one of its short sides, its height in pixels,
a score, and the object's id: the columns of `rect/NNNN.npy`. The gripper opens along the line from
the centre to the side, by twice its length. Grasps come along the camera's axis.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import cross, unit
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper

MIN_WIDTH = 0.001  # metres, least distance of contacts
MAX_TURN, LEAST_SHARED = np.radians(30.0), 0.25  # limits of a correct rectangle
TIPS_BELOW = 0.02  # metres from the measured surface down to the finger tips
MIN_LINE = 1e-6  # metres; a shorter line has no direction
MIN_PIXELS = 1e-9  # pixels or squared pixels, instead of a length or an area of zero
SCORE_AT_ZERO = 1.1  # the score of a label is this value minus its friction coefficient
ROUNDING = 1e-4  # rounding error of a label's score


class RectColumn:
    """Columns of the rows; pixels."""

    CENTER = slice(0, 2)
    SIDE = slice(2, 4)  # the middle of a short side
    HEIGHT = 4
    SCORE = 5
    OBJECT_ID = 6


def rectangle_rows(
    center: Array, angle: Array, opening: Array, height: Array, score: Array
) -> Array:
    """Return rows (n, 7), object id -1, of rectangles.

    Args:
        center: (n, 2) pixels.
        angle: (n,) radians of the opening line, counter-clockwise on the screen.
        opening: (n,) pixels.
        height: (n,) pixels.
        score: (n,).
    """
    along = np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    side = center + 0.5 * opening[:, None] * along
    return np.column_stack([center, side, height, score, np.full(len(center), -1.0)])


def angles(rows: Array) -> Array:
    """Return the angle (n,) of the opening line, counter-clockwise, radians in [-pi/2, pi/2)."""
    line = _half_openings(rows)
    angle = np.arctan2(-line[:, 1], line[:, 0])
    return np.asarray(np.mod(angle + 0.5 * np.pi, np.pi) - 0.5 * np.pi)


def opening_pixels(rows: Array) -> Array:
    """Return the opening (n,) of the fingers in pixels."""
    return np.asarray(2.0 * np.linalg.norm(_half_openings(rows), axis=1))


def _half_openings(rows: Array) -> Array:
    """Return the vectors (n, 2) from the centres to the sides, pixels."""
    return np.asarray(rows[:, RectColumn.SIDE] - rows[:, RectColumn.CENTER])


def corners(rows: Array, share: float = 1.0) -> Array:
    """Return the corners (n, 4, 2) of the middle `share` along the opening."""
    half = share * _half_openings(rows)
    length = np.maximum(np.linalg.norm(half, axis=1, keepdims=True), MIN_PIXELS)
    half_height = 0.5 * rows[:, RectColumn.HEIGHT, None]
    across = np.stack([-half[:, 1], half[:, 0]], axis=1) / length * half_height
    center = rows[:, RectColumn.CENTER]
    ends = [center + half + across, center + half - across]
    return np.stack([*ends, center - half - across, center - half + across], axis=1)


def hold_at(rows: Array, friction: float) -> Mask:
    """Return a mask (n,) of the labels `rows` (n, 7) that hold at this `friction` coefficient."""
    return np.asarray(rows[:, RectColumn.SCORE] >= SCORE_AT_ZERO - friction - ROUNDING)


def on_their_object(rows: Array, label: NDArray[np.integer]) -> Mask:
    """Return a mask (n,) of the rows with a visible object at the centre; labels do not state it.

    Args:
        rows: (n, 7).
        label: (H, W) object id + 1, 0 = background.
    """
    pixels = np.rint(rows[:, RectColumn.CENTER]).astype(np.int64)
    inside = (pixels >= 0).all(axis=1)
    inside &= (pixels[:, 0] < label.shape[1]) & (pixels[:, 1] < label.shape[0])
    found = np.full(len(rows), -1, np.int64)
    found[inside] = label[pixels[inside, 1], pixels[inside, 0]].astype(np.int64) - 1
    return np.asarray(inside & (found == rows[:, RectColumn.OBJECT_ID].astype(np.int64)))


def rectangle_hits(found: Array, true: Array) -> Mask:
    """Return a mask (n,) of the correct rectangles in `found` (n, 7), by the rectangle metric.

    A correct rectangle overlaps one of `true` (m, 7) by more than a quarter of their union and
    differs from it in angle by less than 30 degrees.
    """
    turn = np.abs(angles(found)[:, None] - angles(true))
    turn = np.minimum(turn, np.pi - turn)
    boxes = [[_turned_box(row) for row in rows] for rows in (found, true)]
    right = np.zeros(len(found), bool)
    for i, j in np.argwhere(turn < MAX_TURN).tolist():
        right[i] = right[i] or _overlap(boxes[0][i], boxes[1][j]) > LEAST_SHARED
    return right


def _turned_box(row: Array) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """Return a rectangle in OpenCV's form: centre, size, angle clockwise in degrees."""
    (angle,), (opening,) = angles(row[None]), opening_pixels(row[None])
    x, y = row[RectColumn.CENTER].tolist()
    size = float(opening), float(row[RectColumn.HEIGHT])
    return (x, y), size, float(-np.degrees(angle))


def _overlap(one: Any, other: Any) -> float:  # noqa: ANN401 - OpenCV's rectangle
    """Return the intersection of two rectangles over their union."""
    kind, shared = cv2.rotatedRectangleIntersection(one, other)
    if kind == cv2.INTERSECT_NONE:
        return 0.0
    area = float(cv2.contourArea(cv2.convexHull(shared)))
    union = float(one[1][0] * one[1][1] + other[1][0] * other[1][1]) - area
    return area / max(union, MIN_PIXELS)


def rectangle_grasps(
    rows: Array, depth: Array, intrinsics: Intrinsics, gripper: Gripper
) -> tuple[GraspPoses, Indices]:
    """Return the grasps of `rows` (n, 7), and the row of each; some rows have none.

    As in GraspNet-1Billion's benchmark, the rectangle is at the depth of its centre along the
    camera's axis, and the finger tips are 2 cm below.

    Args:
        rows: pixels of `depth`.
        depth: (H, W) metres, 0 where missing; a centre without depth gives no grasp.
        intrinsics: intrinsics of `depth`.
        gripper: the gripper of the grasps.
    """
    pixels = np.rint(rows[:, RectColumn.CENTER]).astype(np.int64)
    index = np.flatnonzero(
        (pixels >= 0).all(axis=1)
        & (pixels[:, 0] < depth.shape[1])
        & (pixels[:, 1] < depth.shape[0])
    )
    z = depth[pixels[index, 1], pixels[index, 0]].astype(np.float64)
    index, z = index[z > 0], z[z > 0]
    columns = RectColumn.CENTER, RectColumn.SIDE
    origin, side = (intrinsics.points_at(rows[index, each], z) for each in columns)
    line = side - origin
    length = np.linalg.norm(line, axis=1)
    long = length > MIN_LINE
    index, origin, line, length = index[long], origin[long], line[long], length[long]
    closing = unit(line)
    approach = np.broadcast_to([0.0, 0.0, 1.0], closing.shape)
    rotation = np.stack([approach, closing, cross(approach, closing)], axis=-1)
    forward = (TIPS_BELOW - gripper.tip_reach) * approach
    return GraspPoses(rotation, origin + forward, contact_width(2.0 * length, gripper)), index


def contact_width(opening: Array, gripper: Gripper) -> Array:
    """Return the contact distance (n,) of grasps with an `opening` of (n,) metres.

    Openings are limited to the gripper's; the fingers keep their clearance.
    """
    widest = np.minimum(opening, gripper.max_opening)
    return np.maximum(widest - 2.0 * gripper.clearance, MIN_WIDTH)
