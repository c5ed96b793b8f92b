"""A picture of one annotated object: two views with planes, axes, spheres and regions drawn in.

Sheets in the colour of their number: mirror planes 0, 1, 2, cut out where the object hides the
sheet, with the line where the plane cuts the surface. Red bars: rotation axes; red rings: spheres.
Regions of the surface have different colours. Dashed grey: the nearest rejected candidate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import Hits, Scene, cast_view
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.geometry.transforms import invert, transform_points
from pipelines.geometry.viewpoints import camera, oblique_view, symmetry_view
from pipelines.pictures.frame_canvas import FIXED_BITS
from pipelines.pictures.lettering import write_with_halo
from pipelines.pictures.palette import Color, ColorImage

VIEW = 200  # pixels, side length of each of the two views
FINE = 2  # everything is drawn larger by this factor, then averaged
PAPER: Color = (255, 255, 255)
INK: Color = (40, 40, 40)
PLAIN: Color = (214, 210, 200)  # of a surface that is one region
LEFT_OUT: Color = (150, 150, 150)  # of the surface that is in no region
REGIONS: tuple[Color, ...] = (
    (120, 200, 180), (245, 190, 110), (170, 160, 230), (160, 205, 110), (240, 150, 150),
    (120, 185, 235), (205, 180, 140), (220, 150, 210),
)  # fmt: skip
PLANES: tuple[Color, ...] = ((230, 30, 150), (40, 80, 230), (225, 140, 0))
AXIS: Color = (215, 20, 20)
REJECTED: Color = (110, 110, 110)
FLAT_COSINE = 0.95
SHEET_OPACITY = 0.26
HIDDEN_OPACITY = 0.25  # of lines behind the object
OVERHANG = 1.14  # of a sheet or an axis over the object's extent
CUT_REACH = 0.03  # largest distance of a cutting line from its plane, share of the object's size
FARTHEST = 1e4  # pixels, of drawn places
NUM_STEPS = 96  # steps of a line; each step is hidden or visible


@dataclass(frozen=True)
class Mark:
    """A symmetry to draw: colour, optional number, and `dashed` if it was rejected."""

    symmetry: Symmetry
    extent: Mesh  # the part of the surface with this symmetry
    color: Color
    number: int | None = None
    dashed: bool = False


@dataclass
class _View:
    """A rendered view to draw into, at FINE times the final size."""

    picture: ColorImage
    hits: Hits
    intrinsics: Intrinsics
    T_cam_mesh: Array
    size: float  # of the object, metres


def object_views(mesh: Mesh, labels: ObjectSymmetries) -> ColorImage:
    """Return two views of `mesh` with its `labels`, side by side: (VIEW, 2 VIEW, 3) RGB."""
    marks = marks_of(mesh, labels)
    drawn = [mark.symmetry for mark in marks]
    colors = triangle_colors(mesh, labels)
    scene = Scene([mesh], [np.eye(4)])
    views = [
        _draw_view(scene, mesh, pose, marks, colors)
        for pose in (oblique_view(mesh, drawn), symmetry_view(mesh, drawn))
    ]
    return np.concatenate(views, axis=1)


def marks_of(mesh: Mesh, labels: ObjectSymmetries) -> list[Mark]:
    """Return the marks of the symmetries of the object and its parts, else the nearest rejected."""
    marks = []
    numbers: dict[str, int] = {}
    for symmetry in labels.symmetries:
        number = numbers.setdefault(symmetry.kind, 0)
        numbers[symmetry.kind] += 1
        flat = isinstance(symmetry, ReflectionSymmetry)
        color = PLANES[number % len(PLANES)] if flat else AXIS
        marks.append(Mark(symmetry, mesh, color, number if flat else None))
    for index, region in enumerate(labels.regions):
        is_whole = len(region.triangles) == len(mesh.faces)
        if not len(region.triangles) or (is_whole and labels.symmetries):
            continue
        part, light = mesh.submesh(region.triangles), REGIONS[index % len(REGIONS)]
        r, g, b = (int(0.55 * channel) for channel in light)
        marks += [Mark(symmetry, part, (r, g, b)) for symmetry in region.symmetries]
    if not marks and labels.rejected:
        marks.append(Mark(labels.rejected[0], mesh, REJECTED, dashed=True))
    return marks


def triangle_colors(mesh: Mesh, labels: ObjectSymmetries) -> ColorImage:
    """Return the colour (f, 3) of each triangle, by region."""
    colors = np.full((len(mesh.faces), 3), PLAIN, np.uint8)
    parts = [region for region in labels.regions if len(region.triangles) < len(mesh.faces)]
    if parts:
        colors[:] = LEFT_OUT
    for index, region in enumerate(parts):
        colors[region.triangles] = REGIONS[index % len(REGIONS)]
    return colors


def _draw_view(
    scene: Scene, mesh: Mesh, T_mesh_cam: Array, marks: Sequence[Mark], colors: ColorImage
) -> ColorImage:
    intrinsics = camera(FINE * VIEW)
    hits = cast_view(scene, intrinsics, T_mesh_cam)
    view = _View(_shaded(hits, colors), hits, intrinsics, invert(T_mesh_cam), mesh.diagonal)
    for mark in marks:
        match mark.symmetry:
            case ReflectionSymmetry():
                _draw_plane(view, mark, mark.symmetry)
            case RotationSymmetry():
                _draw_axis(view, mark, mark.symmetry)
            case SphereSymmetry():
                _draw_sphere(view, mark, mark.symmetry)
    return np.asarray(
        cv2.resize(view.picture, (VIEW, VIEW), interpolation=cv2.INTER_AREA), np.uint8
    )


def _shaded(hits: Hits, colors: ColorImage) -> ColorImage:
    """Return the picture of the surface in `colors` (f, 3), lit from the camera and above."""
    lamp = np.array([-0.3, -0.5, -0.8]) / np.linalg.norm([0.3, 0.5, 0.8])
    light = 0.45 + 0.35 * np.abs(hits.normal[..., 2]) + 0.25 * np.clip(hits.normal @ lamp, 0, 1)
    shown = np.clip(colors[np.maximum(hits.triangle_index, 0)] * light[..., None], 0, 255)
    return np.where((hits.triangle_index >= 0)[..., None], shown, PAPER).astype(np.uint8)


def _draw_plane(view: _View, mark: Mark, plane: ReflectionSymmetry) -> None:
    corners = transform_points(view.T_cam_mesh, _sheet(mark.extent, plane))
    moved = plane.transformed(view.T_cam_mesh)
    rays = view.intrinsics.rays()
    slope = rays @ moved.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = float(moved.point @ moved.normal) / slope
    points = rays * np.where(np.isfinite(depth), depth, 0.0)[..., None]
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    a, b = (points - corners[0]) @ u / (u @ u), (points - corners[0]) @ v / (v @ v)
    inside = (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1) & (depth > 0)
    front = inside & ((view.hits.depth == 0) | (depth < view.hits.depth))
    # A sheet that faces the camera would only veil the object, without a sharp cut.
    if abs(moved.normal[2]) < FLAT_COSINE:
        _tint(view.picture, front, mark.color, 0.0 if mark.dashed else SHEET_OPACITY)
        _tint(view.picture, _cut(view, moved), mark.color, 0.5 if mark.dashed else 0.9)
    for start, end in pairwise([*corners, corners[0]]):
        _line(view, start, end, mark.color, 2, dashed=mark.dashed)
    if mark.number is not None:
        pixels = view.intrinsics.project(corners)
        _label(view.picture, str(mark.number), pixels[pixels[:, 1].argmin()], mark.color)


def _cut(view: _View, plane: ReflectionSymmetry) -> Mask:
    """Return the pixels (H, W) in which the surface passes through `plane`."""
    seen = view.hits.depth > 0
    points = view.intrinsics.rays() * view.hits.depth[..., None]
    height = np.where(seen, (points - plane.point) @ plane.normal, np.nan)
    near = np.abs(height) < CUT_REACH * view.size
    cut = np.zeros_like(seen)
    side = height > 0
    cut[:, 1:] |= (side[:, 1:] != side[:, :-1]) & near[:, 1:] & near[:, :-1]
    cut[1:] |= (side[1:] != side[:-1]) & near[1:] & near[:-1]
    return np.asarray(cv2.dilate(cut.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def _sheet(extent: Mesh, plane: ReflectionSymmetry) -> Array:
    """Return the corners (4, 3) of the rectangle in `plane` that tightly frames `extent`."""
    used = extent.vertices[np.unique(extent.faces)]
    flat = used - ((used - plane.point) @ plane.normal)[:, None] * plane.normal
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    spread = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2]
    u = spread[0] - (spread[0] @ plane.normal) * plane.normal
    u = u / np.linalg.norm(u)
    v = np.cross(plane.normal, u)
    across = np.stack([(flat - middle) @ u, (flat - middle) @ v], axis=1)
    low, high = across.min(axis=0), across.max(axis=0)
    center, half = 0.5 * (low + high), 0.5 * OVERHANG * (high - low)
    half = np.maximum(half, 0.1 * half.max())
    place = center + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    return np.asarray(middle + place[:, :1] * u + place[:, 1:] * v)


def _draw_axis(view: _View, mark: Mark, axis: RotationSymmetry) -> None:
    along = (mark.extent.vertices[np.unique(mark.extent.faces)] - axis.point) @ axis.axis
    middle, half = 0.5 * (along.min() + along.max()), 0.5 * np.ptp(along)
    reach = max(half * OVERHANG + 0.06 * view.size, 0.1 * view.size)
    ends = axis.point + (middle + np.array([[-reach], [reach]])) * axis.axis
    ends = transform_points(view.T_cam_mesh, ends)
    _line(view, ends[0], ends[1], mark.color, 5, dashed=mark.dashed)
    pixels = view.intrinsics.project(ends)
    for pixel in pixels:
        _dot(view.picture, pixel, 4 * FINE, mark.color)
    name = "round" if axis.order is None else f"x{axis.order}"
    _label(view.picture, name, pixels[pixels[:, 1].argmin()], mark.color)


def _draw_sphere(view: _View, mark: Mark, sphere: SphereSymmetry) -> None:
    used = mark.extent.vertices[np.unique(mark.extent.faces)]
    radius = float(np.median(np.linalg.norm(used - sphere.point, axis=1)))
    center = transform_points(view.T_cam_mesh, sphere.point)
    pixel = view.intrinsics.project(center)
    size = round(radius / np.sqrt(max(center[2] ** 2 - radius**2, 1e-12)) * view.intrinsics.fx)
    place = (round(float(pixel[0])), round(float(pixel[1])))
    cv2.circle(view.picture, place, size, mark.color, 2 * FINE, cv2.LINE_AA)
    _dot(view.picture, pixel, 3 * FINE, mark.color)
    _label(view.picture, "sphere", pixel - np.array([0, size]), mark.color)


def _line(
    view: _View, start: Array, end: Array, color: Color, width: int, *, dashed: bool = False
) -> None:
    """Draw a line between two points (3,), camera frame, fainter where the object hides it."""
    points = start + np.linspace(0.0, 1.0, NUM_STEPS + 1)[:, None] * (end - start)
    pixels = view.intrinsics.project(points)
    column, row = np.rint(pixels).astype(int).T.clip(0, view.intrinsics.width - 1)
    surface = view.hits.depth[row, column]
    hidden = (surface > 0) & (points[:, 2] > surface + 1e-3 * view.size)
    faint = view.picture.copy()
    for layer, wanted in ((faint, True), (view.picture, False)):
        for step in range(NUM_STEPS):
            if (hidden[step] and hidden[step + 1]) == wanted and not (dashed and step // 4 % 2):
                first, second = (_fixed(pixels[step]), _fixed(pixels[step + 1]))
                cv2.line(layer, first, second, color, width, cv2.LINE_AA, FIXED_BITS)
        if wanted:
            cv2.addWeighted(
                faint, HIDDEN_OPACITY, view.picture, 1 - HIDDEN_OPACITY, 0, dst=view.picture
            )


def _tint(picture: ColorImage, mask: Mask, color: Color, opacity: float) -> None:
    mixed = (1.0 - opacity) * picture[mask] + opacity * np.array(color)
    picture[mask] = np.rint(mixed).astype(np.uint8)


def _dot(picture: ColorImage, pixel: Array, radius: int, color: Color) -> None:
    place, size = _fixed(pixel), radius << FIXED_BITS
    cv2.circle(picture, place, size, color, -1, cv2.LINE_AA, FIXED_BITS)


def _label(picture: ColorImage, text: str, pixel: Array, color: Color) -> None:
    """Write `text` next to `pixel`, within the picture, on a white halo."""
    font, scale = cv2.FONT_HERSHEY_DUPLEX, 0.45 * FINE
    (width, height), _ = cv2.getTextSize(text, font, scale, FINE)
    x = int(np.clip(pixel[0] + 4 * FINE, 0, picture.shape[1] - width - 2))
    y = int(np.clip(pixel[1] + 3 * FINE, height + 2, picture.shape[0] - 4))
    inks = color, PAPER
    write_with_halo(picture, text, (x, y), scale, inks, weight=FINE, rim=FINE, font=font)


def _fixed(pixel: Array) -> tuple[int, int]:
    """Return a pixel as OpenCV's fixed-point numbers."""
    x, y = np.rint(np.clip(pixel, -FARTHEST, FARTHEST) * (1 << FIXED_BITS)).astype(int)
    return int(x), int(y)
