"""Selection of the foreground's surfaces that reach down to the support plane.

An arm that hangs into the image, or an object beyond the table, does not.
"""

import cv2
import numpy as np
from scipy.spatial import KDTree

from pipelines.array_types import Array, Mask
from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.depth_segments import BULK_ENDS, Labels, extent
from pipelines.tabletop.regions.pieces import (
    UNMEASURED,
    Box,
    LabelledPiece,
    box_of,
    pieces_of_labels,
    with_margin,
)
from pipelines.tabletop.tabletop import Tabletop

FOOT = 6  # pixels below and above a piece where a nearer piece, or missing depth, may hide its foot
FEET = 500  # points of a piece whose feet on the table are checked
HIDDEN_FOOT = 0.3  # least share of the pixels within `FOOT` that hide the foot
KNOWN_FEET = 0.5  # least share of these feet with measured depth
LOWEST = 0.15  # share of a piece's points that are its lowest, or its highest
DROPS = 0.04, 0.06, 0.1  # metres beneath the lowest points where background may be seen
BEHIND = 0.03  # least metres from such a place to the background seen there
MIN_FREE = 0.6  # least share of these places with background
JOINT = 0.03  # metres between a hanging piece and its foot
TABLE_BENEATH = 0.25  # largest share of these feet that show the table


def standing(
    xyz: Array, surfaces: Labels, tabletop: Tabletop, camera: Intrinsics, config: RegionConfig
) -> Mask:
    """Return a mask (n + 1,) of the n surfaces that may reach down to the table.

    The foot may lack depth, or be hidden by a nearer surface, or by the surface itself in a view
    from above. An arm that hangs into the image, its foot, or an object beyond the table does not.

    Args:
        xyz: (H, W, 3) metres, camera frame, nan where missing.
        surfaces: (H, W) of `depth_segments.segment`; 0 is no surface.
        tabletop: the support plane and the foreground.
        camera: intrinsics of `xyz`.
        config: thresholds.
    """
    result = np.ones(int(surfaces.max(initial=0)) + 1, bool)
    plane = tabletop.plane
    if plane is None:
        return result
    measured = box_of(np.isfinite(xyz[..., 2]))
    pieces = pieces_of_labels(surfaces, xyz, config.min_pixels)
    floating = [
        piece
        for piece in pieces
        if quantiles(plane.height(piece.points), BULK_ENDS[0]) >= config.max_floating
    ]
    # A free-hanging piece is held from outside the image, or by something unseen (D. 136).
    hanging = [
        piece
        for piece in floating
        if _reaches_out(piece.box, measured) and _hangs_free(piece, xyz, plane, camera)
    ]
    arms = [piece.label for piece in hanging]
    result[arms] = False
    for piece in floating:
        if not result[piece.label]:
            continue
        # A step in depth separates a finger from its hand.
        if _is_beside(piece, arms, surfaces) and _hangs_free(piece, xyz, plane, camera):
            result[piece.label] = False
        elif not _foot_may_be_hidden(piece, xyz, surfaces, plane):
            result[piece.label] = _hides_its_foot(piece, xyz, plane, camera, config)
    for piece in pieces if hanging else ():
        if result[piece.label] and extent(piece.points) > config.max_cut_extent:
            result[piece.label] = not any(_carries(piece, each, plane) for each in hanging)
    return result


def _reaches_out(box: Box, measured: Box) -> bool:
    """Return whether a piece in `box` reaches the border of the `measured` box."""
    return any(
        own.start < seen.start + UNMEASURED or own.stop > seen.stop - UNMEASURED
        for own, seen in zip(box, measured, strict=True)
    )


def _is_beside(piece: LabelledPiece, others: list[int], surfaces: Labels) -> bool:
    """Return whether a piece is within `FOOT` pixels of one of the pieces labelled `others`."""
    around = surfaces[with_margin(piece.box, FOOT)]
    side = 2 * FOOT + 1
    near = cv2.dilate((around == piece.label).astype(np.uint8), np.ones((side, side), np.uint8))
    return bool(np.isin(around[near > 0], others).any())


def _hangs_free(piece: LabelledPiece, xyz: Array, plane: Plane, camera: Intrinsics) -> bool:
    """Return whether background is seen beneath the lowest points of a piece."""
    height = plane.height(piece.points)
    low = piece.points[height <= quantiles(height, LOWEST)]
    low = strided_at_least(low, FEET)
    for drop in DROPS:
        pixels, shown = camera.pixels_of(low - drop * plane.normal)
        seen = xyz[pixels[shown, 1], pixels[shown, 0], 2]
        expected = low[shown, 2] - drop * plane.normal[2]
        if np.count_nonzero(seen > expected + BEHIND) > MIN_FREE * len(low):
            return True
    return False


def _carries(piece: LabelledPiece, hanging: LabelledPiece, plane: Plane) -> bool:
    """Return whether the lowest points of `hanging` are on the top of `piece`."""
    height, over = plane.height(piece.points), plane.height(hanging.points)
    top = piece.points[height >= quantiles(height, 1.0 - LOWEST)]
    foot = hanging.points[over <= quantiles(over, LOWEST)]
    if foot.mean(axis=0) @ plane.normal < top.mean(axis=0) @ plane.normal:
        return False
    some = strided_at_least(foot, FEET)
    return bool(np.min(KDTree(top).query(some)[0]) < JOINT)


def _foot_may_be_hidden(piece: LabelledPiece, xyz: Array, surfaces: Labels, plane: Plane) -> bool:
    """Return whether nearer pieces, or missing depth, border the lower side of a piece."""
    foot = FOOT if plane.normal[1] <= 0.0 else 0  # down in the image, or up
    box = with_margin(piece.box, FOOT)
    around, z = surfaces[box], xyz[..., 2][box]
    inside = around == piece.label
    shape = inside.astype(np.uint8)
    beside = (cv2.dilate(shape, np.ones((2 * FOOT + 1, 1), np.uint8)) > 0) & ~inside
    nearer = (around > 0) & (z < median(piece.points[:, 2]))
    beneath = cv2.dilate(shape, np.ones((FOOT + 1, 1), np.uint8), anchor=(0, foot)) > 0
    hidden = beside & (nearer | (beneath & np.isnan(z)))
    return bool(hidden.sum() > FOOT * HIDDEN_FOOT * np.count_nonzero(inside.any(axis=0)))


def _hides_its_foot(
    piece: LabelledPiece, xyz: Array, plane: Plane, camera: Intrinsics, config: RegionConfig
) -> bool:
    """Return whether no table is seen where vertical walls under a piece's outline would end.

    False for a piece at the image border, which may be an arm.
    """
    rows, columns = piece.box
    cut = rows.start == 0 or columns.start == 0
    if cut or rows.stop == xyz.shape[0] or columns.stop == xyz.shape[1]:
        return False
    some = strided_at_least(piece.points, FEET)
    pixels, shown = camera.pixels_of(some - plane.height(some)[:, None] * plane.normal)
    seen = xyz[pixels[shown, 1], pixels[shown, 0]]
    seen = seen[np.isfinite(seen[:, 2])]
    on_table = np.count_nonzero(plane.height(seen) < config.max_floating / 2.0)
    return bool(len(seen) > KNOWN_FEET * len(some) and on_table < TABLE_BENEATH * len(seen))
