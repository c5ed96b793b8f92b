"""A frame's picture with its regions, symmetries and best grasps drawn onto it.

Outlines: regions, each with its number and best score, and "flat" or "no depth" where depth does
not show the region. Translucent quads: symmetry planes; bars: rotation axes; rings: spheres.
Wireframes: the gripper at each region's best grasp in the colour of its score, a dot at each
contact; thin and without dots if the grasp is not worth trying. The PNG holds the stamp of the
drawn result, as the text `provenance`.
"""

import json
import zlib
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from pipelines.array_types import Array, Mask
from pipelines.frames.rgbd import Frame
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT, Symmetry, SymmetrySlots
from pipelines.geometry.transforms import unit
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.pictures.frame_canvas import FARTHEST_PLACE, FIXED_BITS, FrameCanvas, PixelBox
from pipelines.pictures.number_labels import write_numbers
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
USED_OPACITY, OPACITY = 0.35, 0.1  # of the plane that gave the best grasp, and of others
STAMP_TEXT = "provenance"  # the name of the PNG's text


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


def draw_overlay(
    frame: Frame, result: FrameResult, part: PixelBox | None = None, width: int | None = None
) -> ColorImage:
    """Return the picture (H, W, 3) RGB of a frame with its regions, symmetries and grasps.

    Lines and labels are as thick and large in an enlarged part as in a whole picture of that width.

    Args:
        frame: colour, depth and camera.
        result: of the frame.
        part: of the frame to show; all of it if None.
        width: of the picture in pixels; the part is not scaled if None.
    """
    canvas, (height, across) = FrameCanvas.of(frame, part, width), frame.color.shape[:2]
    masks = [result.regions.mask(i, across, height) for i in range(len(result.regions))]
    for region, mask in enumerate(masks):
        canvas.outline(mask, rgb(region_color(region)))  # beneath the ring of a ball
        _draw_symmetries(canvas, frame, result, region, mask)
    best = np.flatnonzero(result.grasps.is_best)
    for grasp in best[np.argsort(-result.grasps.rank_in_frame[best])]:  # the best grasp on top
        _draw_gripper(canvas, result, int(grasp))
    write_numbers(canvas, result, masks)
    return canvas.picture


def _draw_gripper(canvas: FrameCanvas, result: FrameResult, grasp: int) -> None:
    picture, thick, table = canvas.picture, canvas.thick, result.grasps
    rotation, middle = table.rotation[grasp].astype(float), table.translation[grasp].astype(float)
    half = float(table.width[grasp]) / 2.0
    corners = np.array([
        [0.0, -half, 0], [-FINGER, -half, 0], [-FINGER, half, 0], [0.0, half, 0],
        [-FINGER, 0, 0], [-FINGER - WRIST, 0, 0],
    ])  # fmt: skip
    pixels = canvas.pixels(corners @ rotation.T + middle)
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
    canvas: FrameCanvas, frame: Frame, result: FrameResult, region: int, mask: Mask
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


def _draw_sphere(canvas: FrameCanvas, center: Array, cloud: Array) -> None:
    """Draw the outline of the sphere about `center` (3,) through the region's points (n, 3)."""
    radius = float(np.median(np.linalg.norm(cloud - center, axis=1)))
    pixels = canvas.pixels(center[None])
    if pixels is None or center[2] <= radius:  # the ball reaches behind the camera
        return
    # Rays touch the ball in front of its center, so its outline is larger than its middle.
    size = canvas.camera.fx * radius / np.sqrt(center[2] ** 2 - radius**2) * (1 << FIXED_BITS)
    place, ring = (int(pixels[0, 0]), int(pixels[0, 1])), round(min(size, FARTHEST_PLACE))
    color = rgb(AXIS_COLOR)
    cv2.circle(canvas.picture, place, ring, color, canvas.thick, cv2.LINE_AA, FIXED_BITS)


def _draw_axis(canvas: FrameCanvas, axis: Symmetry, radius: float) -> None:
    ends = canvas.pixels(axis.point + 1.3 * radius * np.array([[-1], [1]]) * axis.direction)
    if ends is not None:
        first, second = ends.tolist()
        for color, size in ((HALO, 4 * canvas.thick), (rgb(AXIS_COLOR), 2 * canvas.thick)):
            cv2.line(canvas.picture, first, second, color, size, cv2.LINE_AA, FIXED_BITS)


def _draw_plane(
    canvas: FrameCanvas, plane: Symmetry, radius: float, color: Color, opacity: float
) -> None:
    # One side of the quad is level in the image, so the quad looks like a sheet, not a kite.
    across = np.cross(plane.direction, [0.0, 1.0, 0.0])
    if np.linalg.norm(across) < 0.1:
        across = np.cross(plane.direction, [1.0, 0.0, 0.0])
    across = unit(across)
    up = np.cross(plane.direction, across)
    signs = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    corners = plane.point + 0.8 * radius * (signs[:, :1] * across + signs[:, 1:] * up)
    pixels = canvas.pixels(corners)
    if pixels is None:
        return
    picture = canvas.picture
    sheet = picture.copy()
    cv2.fillConvexPoly(sheet, pixels, color, cv2.LINE_AA, FIXED_BITS)
    cv2.addWeighted(sheet, opacity, picture, 1.0 - opacity, 0.0, dst=picture)
    cv2.polylines(picture, [pixels], True, color, canvas.thick, cv2.LINE_AA, FIXED_BITS)
