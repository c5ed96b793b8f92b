"""A frame's picture with its regions, symmetries and best grasps drawn onto it.

Outlines: regions, each with its number and best score, and "flat" or "no depth" where depth does
not show the region. Translucent quads: symmetry planes; bars: rotation axes; rings: spheres.
Wireframes: the gripper at each region's best grasp in the colour of its score, a dot at each
contact; thin and without dots if the grasp is not worth trying. The PNG holds the stamp of the
drawn result, as the text `provenance`.
"""

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from pipelines.array_types import Array, Mask
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT, Symmetry, SymmetrySlots
from pipelines.geometry.transforms import unit
from pipelines.grasp_files.grasps_tables import REGION_MEASURED, FrameResult
from pipelines.pictures.lettering import write_with_halo
from pipelines.pictures.palette import (
    AXIS_COLOR,
    CONTACT_COLOR,
    PLANE_COLORS,
    Color,
    ColorImage,
    region_color,
    rgb,
    score_colors,
)
from pipelines.storage.files import write_bytes
from pipelines.storage.provenance import COMPARED, Stamp

HALO: Color = (0, 0, 0)
FINGER, WRIST = 0.045, 0.05  # metres, of the drawn gripper
NEAREST = 0.02  # metres; shapes with a nearer point are not drawn
USED_OPACITY, OPACITY = 0.35, 0.1  # of the plane that gave the best grasp, and of others
FONT = cv2.FONT_HERSHEY_SIMPLEX
FIXED_BITS = 3  # OpenCV draws at eighths of a pixel
FARTHEST = 1e6  # eighths of a pixel, of drawn places
TextBox = tuple[int, int, int, int]  # x0, y0, x1, y1 pixels
STAMP_TEXT = "provenance"  # the name of the PNG's text


@dataclass(frozen=True)
class _Canvas:
    """A picture (H, W, 3) to draw on, its camera, and the width of thin lines in pixels."""

    picture: ColorImage
    camera: Intrinsics
    thick: int


def write_overlay(path: Path, frame: Frame, result: FrameResult, stamp: Stamp) -> None:
    """Draw `result` onto the colour image of `frame` and write it as PNG, atomically.

    `stamp`: of the result, to identify the run of the grasps in the picture.
    """
    texts, data = PngInfo(), BytesIO()
    texts.add_text(STAMP_TEXT, stamp.as_text())
    image = Image.fromarray(draw_overlay(frame, result))
    image.save(data, "PNG", pnginfo=texts, compress_type=zlib.Z_RLE)  # a third of the time
    write_bytes(path, data.getvalue())


def is_drawn(path: Path, stamp: Stamp) -> bool:
    """Return whether `path` is a picture of the result with this `stamp`."""
    wanted = stamp.as_json()
    try:
        with Image.open(path, formats=["PNG"]) as image:  # reads the texts, not the pixels
            found = json.loads(image.info.get(STAMP_TEXT, ""))
    except (OSError, SyntaxError, ValueError):  # no picture, or none of ours
        return False
    return isinstance(found, dict) and all(found.get(key) == wanted[key] for key in COMPARED)


def draw_overlay(frame: Frame, result: FrameResult) -> ColorImage:
    """Return the picture (H, W, 3) RGB of a frame with its regions, symmetries and grasps."""
    picture = np.ascontiguousarray(frame.color).copy()
    height, width = picture.shape[:2]
    thick = max(1, round(width / 640))
    canvas = _Canvas(picture, frame.intrinsics, thick)
    masks = [result.regions.mask(i, width, height) for i in range(len(result.regions))]
    for region, mask in enumerate(masks):
        draw_outline(picture, mask, region, thick)  # beneath the ring of a ball, which covers it
        _draw_symmetries(canvas, frame, result, region, mask)
    best = np.flatnonzero(result.grasps.is_best)
    for grasp in best[np.argsort(-result.grasps.rank_in_frame[best])]:  # the best grasp on top
        _draw_gripper(canvas, result, int(grasp))
    _write_numbers(picture, result, masks)
    return picture


def draw_outline(picture: ColorImage, mask: Mask, region: int, thick: int) -> None:
    """Draw the outline of a region's `mask` (H, W) in its colour, `thick` pixels wide."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, rgb(region_color(region)), thick, cv2.LINE_AA)


def _write_numbers(picture: ColorImage, result: FrameResult, masks: Sequence[Mask]) -> None:
    """Write the label of each region above its mask, or where it hides no label before it."""
    scale = picture.shape[1] / 1280
    weight = rim = max(1, round(2 * scale))
    boxes: list[TextBox] = []
    for region, mask in enumerate(masks):
        rows, columns = np.nonzero(mask)
        if not len(rows):
            continue
        text = _label(result, region)
        (width, height), _ = cv2.getTextSize(text, FONT, scale, weight)
        x = int(np.clip(np.median(columns) - width / 2, 0, picture.shape[1] - width))
        y = int(np.clip(rows.min() - height // 2, height + 1, picture.shape[0] - 2))
        box = _free_box((x - rim, y - height - rim, x + width + rim, y + rim), boxes, picture)
        boxes.append(box)
        inks = rgb(region_color(region)), HALO
        write_with_halo(picture, text, (x, box[3] - rim), scale, inks, weight=weight, rim=rim)


def _label(result: FrameResult, region: int) -> str:
    """Return a region's number, its best score, and its status if not measured."""
    grasps = result.grasps
    best = grasps.rank_score[(grasps.region == region) & grasps.is_best]
    status = str(result.regions.status[region])
    text = f"{region}" + (f": {best[0]:.2f}" if len(best) else "")
    return text + ("" if status == REGION_MEASURED else f" {status.replace('_', ' ')}")


def _free_box(box: TextBox, others: Sequence[TextBox], picture: ColorImage) -> TextBox:
    """Return `box` moved up or down by the fewest of its heights, to meet none of `others`.

    A picture without such a place within its edges gives `box` as it is.
    """
    x0, y0, x1, y1 = box
    height, rows = y1 - y0, picture.shape[0]
    for step in sorted(range(-(rows // height), rows // height + 1), key=abs):
        top, bottom = y0 + step * height, y1 + step * height
        is_free = all(
            x1 <= left or right <= x0 or bottom <= high or low <= top
            for left, high, right, low in others
        )
        if is_free and (step == 0 or (top >= 0 and bottom <= rows)):
            return x0, top, x1, bottom
    return box


def _draw_gripper(canvas: _Canvas, result: FrameResult, grasp: int) -> None:
    picture, thick, table = canvas.picture, canvas.thick, result.grasps
    rotation, middle = table.rotation[grasp].astype(float), table.translation[grasp].astype(float)
    half = float(table.width[grasp]) / 2.0
    corners = np.array([
        [0.0, -half, 0], [-FINGER, -half, 0], [-FINGER, half, 0], [0.0, half, 0],
        [-FINGER, 0, 0], [-FINGER - WRIST, 0, 0],
    ])  # fmt: skip
    pixels = _pixels(canvas.camera, corners @ rotation.T + middle)
    if pixels is None:
        return
    r, g, b = score_colors(table.rank_score[grasp : grasp + 1])[0].tolist()
    is_weak = not table.worth_trying[grasp]
    lines = (((r, g, b), thick),) if is_weak else ((HALO, 2 * thick + 2), ((r, g, b), 2 * thick))
    for line_color, size in lines:
        for start, end in ((0, 1), (1, 2), (2, 3), (4, 5)):
            ends = pixels[start].tolist(), pixels[end].tolist()
            cv2.line(picture, *ends, line_color, size, cv2.LINE_AA, FIXED_BITS)
    if is_weak:
        return
    for contact in (0, 3):
        center = tuple(int(x) for x in pixels[contact])
        radius = (3 * thick) << FIXED_BITS
        cv2.circle(picture, center, radius, rgb(CONTACT_COLOR), -1, cv2.LINE_AA, FIXED_BITS)


def _draw_symmetries(
    canvas: _Canvas, frame: Frame, result: FrameResult, region: int, mask: Mask
) -> None:
    table = result.regions
    slots = SymmetrySlots(
        table.symmetry_confidence[region].astype(float),
        table.symmetry_point[region].astype(float),
        table.symmetry_direction[region].astype(float),
    )
    found = np.flatnonzero(slots.probability > 0.5).tolist()
    existing = [slot for slot in found if _is_known(slots, slot)]
    cloud = _points_of(frame, mask) if existing else np.zeros((0, 3))
    if not len(cloud):
        return
    radius = float(np.percentile(np.linalg.norm(cloud - np.median(cloud, axis=0), axis=1), 90))
    grasps = result.grasps
    used = grasps.symmetry_slot[(grasps.region == region) & grasps.is_best].tolist()
    for slot in existing:
        opacity, symmetry = USED_OPACITY if slot in used else OPACITY, slots.symmetry(slot)
        if slot == SPHERE_SLOT:
            _draw_sphere(canvas, symmetry.point, cloud)
        elif slot == ROTATION_SLOT:
            _draw_axis(canvas, symmetry, radius)
        else:
            _draw_plane(canvas, symmetry, radius, rgb(PLANE_COLORS[slot]), opacity)


def _points_of(frame: Frame, mask: Mask) -> Array:
    """Return the points (n, 3) of the pixels of `mask` (H, W) with depth, camera frame."""
    rows, columns = np.nonzero(mask & (frame.depth > 0))
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    return frame.intrinsics.points_at(pixels, frame.depth[rows, columns].astype(np.float64))


def _is_known(slots: SymmetrySlots, slot: int) -> bool:
    known = np.isfinite(slots.point[slot]).all()
    return bool(known and (slot == SPHERE_SLOT or np.isfinite(slots.direction[slot]).all()))


def _draw_sphere(canvas: _Canvas, center: Array, cloud: Array) -> None:
    """Draw the outline of the sphere about `center` (3,) through the region's points (n, 3)."""
    radius = float(np.median(np.linalg.norm(cloud - center, axis=1)))
    pixels = _pixels(canvas.camera, center[None])
    if pixels is None or center[2] <= radius:  # the ball reaches behind the camera
        return
    # Rays touch the ball in front of its center, so its outline is larger than its middle.
    size = canvas.camera.fx * radius / np.sqrt(center[2] ** 2 - radius**2) * (1 << FIXED_BITS)
    place, ring = (int(pixels[0, 0]), int(pixels[0, 1])), round(min(size, FARTHEST))
    color = rgb(AXIS_COLOR)
    cv2.circle(canvas.picture, place, ring, color, canvas.thick, cv2.LINE_AA, FIXED_BITS)


def _draw_axis(canvas: _Canvas, axis: Symmetry, radius: float) -> None:
    ends = _pixels(
        canvas.camera, axis.point + 1.3 * radius * np.array([[-1], [1]]) * axis.direction
    )
    if ends is not None:
        first, second = ends.tolist()
        for color, size in ((HALO, 4 * canvas.thick), (rgb(AXIS_COLOR), 2 * canvas.thick)):
            cv2.line(canvas.picture, first, second, color, size, cv2.LINE_AA, FIXED_BITS)


def _draw_plane(
    canvas: _Canvas, plane: Symmetry, radius: float, color: Color, opacity: float
) -> None:
    # One side of the quad is level in the image, so the quad looks like a sheet, not a kite.
    across = np.cross(plane.direction, [0.0, 1.0, 0.0])
    if np.linalg.norm(across) < 0.1:
        across = np.cross(plane.direction, [1.0, 0.0, 0.0])
    across = unit(across)
    up = np.cross(plane.direction, across)
    signs = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    corners = plane.point + 0.8 * radius * (signs[:, :1] * across + signs[:, 1:] * up)
    pixels = _pixels(canvas.camera, corners)
    if pixels is None:
        return
    picture = canvas.picture
    sheet = picture.copy()
    cv2.fillConvexPoly(sheet, pixels, color, cv2.LINE_AA, FIXED_BITS)
    cv2.addWeighted(sheet, opacity, picture, 1.0 - opacity, 0.0, dst=picture)
    cv2.polylines(picture, [pixels], True, color, canvas.thick, cv2.LINE_AA, FIXED_BITS)


def _pixels(camera: Intrinsics, points: Array) -> NDArray[np.int32] | None:
    """Return (n, 2) fixed-point pixels of `points` (n, 3); None if a point is behind the camera."""
    if not (points[:, 2] > NEAREST).all():
        return None
    scaled = camera.project(points) * (1 << FIXED_BITS)
    return np.asarray(np.round(np.clip(scaled, -FARTHEST, FARTHEST)), np.int32)
