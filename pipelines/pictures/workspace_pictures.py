"""A frame's picture with the frame of the workspace, its box and the numbered regions drawn in."""

from collections.abc import Sequence
from itertools import combinations, product

import cv2
import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import invert, transform_points
from pipelines.grasping.feasibility.workspace_box import WorkspaceBox
from pipelines.pictures.frame_canvas import FrameCanvas
from pipelines.pictures.lettering import write_with_halo
from pipelines.pictures.palette import Color, ColorImage, region_color, rgb

AXIS_COLORS: tuple[Color, ...] = ((255, 70, 70), (70, 230, 70), (90, 140, 255))  # x, y, z
AXIS_LENGTH = 0.10  # metres
EDGE_COLOR: Color = (255, 255, 255)
LINE_SEGMENTS = 24  # of a line; segments behind the camera are not drawn
NEAR_PLANE = 0.05  # metres
SHADE = 0.45  # brightness outside of the workspace


def draw_workspace(
    frame: Frame, box: WorkspaceBox, inside: Mask, regions: Sequence[Mask]
) -> ColorImage:
    """Return the picture (H, W, 3) RGB: bright within the workspace, with its axes and box.

    Args:
        frame: colour and camera.
        box: the workspace; the axes of its frame, x red, y green, z blue, are drawn at the low
            corner, because the origin is often outside of the picture.
        inside: (H, W) pixels in the workspace.
        regions: masks (H, W) of regions, drawn with their numbers.
    """
    canvas = FrameCanvas.of(frame)
    picture, thick = canvas.picture, canvas.thick
    picture[~inside] = (picture[~inside] * SHADE).astype(np.uint8)
    for number, mask in enumerate(regions):
        canvas.outline(mask, rgb(region_color(number)))
        rows, columns = np.nonzero(mask)
        place = np.array([np.median(columns), np.median(rows)])
        _letter(picture, str(number), place, rgb(region_color(number)), thick)
    T_cam_box, intrinsics = invert(box.T_box_cam), frame.intrinsics
    corners = np.array(list(product(*box.corners.T)))
    for first, second in combinations(range(8), 2):
        if np.count_nonzero(corners[first] != corners[second]) == 1:
            ends = transform_points(T_cam_box, corners[[first, second]])
            _line_in_space(picture, intrinsics, ends, EDGE_COLOR, thick)
    for axis, color in enumerate(AXIS_COLORS):
        ends = box.corners[0] + np.array([np.zeros(3), AXIS_LENGTH * np.eye(3)[axis]])
        ends = transform_points(T_cam_box, ends)
        _line_in_space(picture, intrinsics, ends, color, 3 * thick)
        if ends[1, 2] > NEAR_PLANE:
            _letter(picture, "xyz"[axis], intrinsics.project(ends[1:])[0], color, thick)
    return picture


def _line_in_space(
    picture: ColorImage, intrinsics: Intrinsics, ends: Array, color: Color, size: int
) -> None:
    """Draw the part of a line that is in front of the camera; `ends` (2, 3), camera frame."""
    shares = np.linspace(0.0, 1.0, LINE_SEGMENTS + 1)[:, None]
    points = ends[0] + shares * (ends[1] - ends[0])
    pixels = intrinsics.project(np.where(points[:, 2:] > NEAR_PLANE, points, [0.0, 0.0, 1.0]))
    places = np.clip(np.rint(pixels), -30000, 30000).astype(int).tolist()
    for i in range(LINE_SEGMENTS):
        if (points[i : i + 2, 2] > NEAR_PLANE).all():
            cv2.line(picture, places[i], places[i + 1], color, size, cv2.LINE_AA)


def _letter(picture: ColorImage, text: str, place: Array, color: Color, thick: int) -> None:
    x, y = np.clip(np.rint(place), -30000, 30000).astype(int).tolist()
    inks = color, (0, 0, 0)
    write_with_halo(picture, text, (x + 3, y - 3), 0.5 * thick, inks, weight=thick, rim=thick)
