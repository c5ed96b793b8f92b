"""Regions without a network: pieces of the foreground that may be objects on the table."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.depth_segments import Labels, segment
from pipelines.tabletop.regions.things import Things
from pipelines.tabletop.tabletop import Tabletop, find_tabletop

Box = tuple[slice, slice]

WORKING_WIDTH = 640  # pixels; larger images are thinned to about this width
FOOT = 6  # pixels below and above a piece where a nearer piece, or missing depth, may hide its foot
FEET = 500  # points of a piece whose feet on the table are checked
KNOWN_FEET = 0.5  # least share of these feet with measured depth
TABLE_BENEATH = 0.25  # largest share of these feet that show the table


@dataclass(frozen=True)
class GeometricRegions:
    """Regions of one frame.

    Attributes:
        labels: (H, W) 1, 2, ... for regions, 0 elsewhere.
        plane: support plane, camera frame, normal to the camera's side; None without one.
        foreground: (H, W) pixels above the plane, in a region or not.
        bare: (H, W) pixels measured on the plane.
        things: tests of further regions, at the working size.
    """

    labels: Labels
    plane: Plane | None
    foreground: Mask
    bare: Mask
    things: Things

    def least_height(self, z: float) -> float:
        """Return the height over the plane that stands out from noise at depth `z`, metres."""
        return float(self.things.top.threshold(z, self.things.config))

    def may_be_thing(self, mask: Mask) -> bool:
        """Return whether `mask` (H, W) is no wall, no arm, and not too large, where depth tells."""
        step = working_step(mask.shape)
        return self.things.may_be(mask[::step, ::step])

    @property
    def masks(self) -> list[Mask]:
        """The regions one by one, (H, W) each."""
        return [self.labels == index for index in range(1, int(self.labels.max(initial=0)) + 1)]


def geometric_regions(
    depth: NDArray[np.floating],
    intrinsics: Intrinsics,
    config: RegionConfig,
    rng: np.random.Generator,
    ground: Mask | None = None,
) -> GeometricRegions:
    """Find the regions of `depth` (H, W) metres, 0 where missing.

    `ground`: (H, W) pixels that may show the support, if known.
    """
    step = working_step(depth.shape)
    small = depth[::step, ::step]
    camera = Intrinsics(
        intrinsics.fx / step,
        intrinsics.fy / step,
        intrinsics.cx / step,
        intrinsics.cy / step,
        small.shape[1],
        small.shape[0],
    )
    xyz = camera.backproject(small)
    ground_seen = None if ground is None else ground[::step, ::step]
    top = find_tabletop(xyz, camera, config, rng, ground_seen)
    pieces, whole = segment(xyz, top.foreground, top.clear, camera.fx, config)
    standing = _standing(xyz, whole, top, camera, config)
    things = Things(xyz, top, ~standing[whole], config)
    labels = _sound_regions(pieces, things)
    above, bare = (enlarged(image, depth.shape) > 0 for image in (top.foreground, top.bare))
    return GeometricRegions(
        enlarged(labels, depth.shape),
        top.plane,
        above,
        bare,
        things,
    )


def working_step(shape: tuple[int, ...]) -> int:
    """Return the stride of rows and columns that thins an image of `shape` to a working size."""
    return max(1, round(max(shape) / WORKING_WIDTH))


def enlarged(image: NDArray[np.generic], shape: tuple[int, ...]) -> Labels:
    """Return a thinned `image` of labels at the size `shape`."""
    if image.shape == shape:
        return image.astype(np.int32)
    size = (shape[1], shape[0])
    return np.asarray(
        cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_NEAREST), np.int32
    )


def _sound_regions(labels: Labels, things: Things) -> Labels:
    """Renumber the regions that may be objects, holes filled, nearest first; drop the others."""
    kept: list[tuple[float, Mask, Box]] = []
    for piece in _pieces(labels, things.xyz, things.config.min_pixels):
        if things.hanging.ravel()[piece.pixels[0]]:
            continue
        mask = labels[piece.box] == piece.label
        border = _border_pixels(mask, *piece.box, labels.shape)
        if things.has_size_and_place(piece.points, border) and things.stands_out(piece.points):
            filled = without_holes(mask) & ((labels[piece.box] == 0) | mask)
            kept.append((float(median(piece.points[:, 2])), filled, piece.box))
    result = np.zeros(labels.shape, np.int32)
    for number, (_, mask, box) in enumerate(sorted(kept, key=lambda entry: entry[0]), 1):
        result[box][mask] = number
    return result


@dataclass(frozen=True)
class _Piece:
    """A labelled piece: flat pixels (n,), their points (n, 3), bounding box in the image."""

    label: int
    pixels: Indices
    points: Array
    box: Box


def _pieces(labels: Labels, xyz: Array, min_pixels: int) -> list[_Piece]:
    """Return the pieces of `labels` (H, W) with at least `min_pixels`, by ascending label."""
    order, end = _by_label(labels.ravel(), int(labels.max(initial=0)))
    found = []
    for label in np.flatnonzero(np.diff(end) >= min_pixels) + 1:
        pixels = order[end[label - 1] : end[label]]
        rows, columns = np.divmod(pixels, labels.shape[1])
        box = slice(rows[0], rows[-1] + 1), slice(columns.min(), columns.max() + 1)
        found.append(_Piece(int(label), pixels, xyz.reshape(-1, 3).take(pixels, axis=0), box))
    return found


@compiled
def _by_label(labels: Labels, count: int) -> tuple[Indices, Indices]:
    """Return the indices of labels 1 to `count`, label by label, and the ends (count + 1,).

    `labels`: (n,). The indices of a label ascend; label 0 is left out and ends at 0.
    """
    end = np.zeros(count + 1, np.int64)
    for n in range(len(labels)):
        if labels[n] > 0:
            end[labels[n]] += 1
    end = np.cumsum(end)
    free, order = end.copy(), np.empty(end[-1], np.int64)
    for n in range(len(labels) - 1, -1, -1):
        if labels[n] > 0:
            free[labels[n]] -= 1
            order[free[labels[n]]] = n
    return order, end


def without_holes(mask: Mask) -> Mask:
    """Return `mask` (h, w) with its holes filled (4-connected)."""
    outside = np.pad(mask.astype(np.uint8), 1)
    cv2.floodFill(outside, None, (0, 0), 1)
    return np.asarray((outside[1:-1, 1:-1] == 0) | mask)


def _standing(
    xyz: Array, whole: Labels, top: Tabletop, camera: Intrinsics, config: RegionConfig
) -> Mask:
    """Return a mask (pieces + 1,) of the connected pieces that may reach down to the table.

    The foot may lack depth, or be hidden by a nearer piece, or by the piece itself in a view from
    above. An arm that hangs into the image, or an object beyond the table, does not reach down.
    """
    result = np.ones(int(whole.max(initial=0)) + 1, bool)
    if top.plane is None:
        return result
    foot = FOOT if top.plane.normal[1] <= 0.0 else 0  # down in the image, or up
    for piece in _pieces(whole, xyz, config.min_pixels):
        if quantiles(top.plane.height(piece.points), 0.02) < config.max_floating:
            continue
        rows, columns = (slice(max(0, s.start - FOOT), s.stop + FOOT) for s in piece.box)
        around = whole[rows, columns]
        inside = around == piece.label
        shape = inside.astype(np.uint8)
        beside = (cv2.dilate(shape, np.ones((2 * FOOT + 1, 1), np.uint8)) > 0) & ~inside
        nearer = (around > 0) & (xyz[rows, columns, 2] < median(piece.points[:, 2]))
        beneath = cv2.dilate(shape, np.ones((FOOT + 1, 1), np.uint8), anchor=(0, foot)) > 0
        hidden = beside & (nearer | (beneath & np.isnan(xyz[rows, columns, 2])))
        enough = FOOT * 0.3 * np.count_nonzero(inside.any(axis=0))
        result[piece.label] = hidden.sum() > enough or _hides_its_foot(
            piece, xyz, top.plane, camera, config
        )
    return result


def _hides_its_foot(
    piece: _Piece, xyz: Array, plane: Plane, camera: Intrinsics, config: RegionConfig
) -> bool:
    """Return whether no table is seen where vertical walls under a piece's outline would end.

    False for a piece at the image border, which may be an arm.
    """
    rows, columns = piece.box
    cut = rows.start == 0 or columns.start == 0
    if cut or rows.stop == xyz.shape[0] or columns.stop == xyz.shape[1]:
        return False
    some = piece.points[:: max(1, len(piece.points) // FEET)]
    pixels, shown = camera.pixels_of(some - plane.height(some)[:, None] * plane.normal)
    seen = xyz[pixels[shown, 1], pixels[shown, 0]]
    seen = seen[np.isfinite(seen[:, 2])]
    on_table = np.count_nonzero(plane.height(seen) < config.max_floating / 2.0)
    return bool(len(seen) > KNOWN_FEET * len(some) and on_table < TABLE_BENEATH * len(seen))


def _border_pixels(mask: Mask, rows: slice, columns: slice, shape: tuple[int, ...]) -> int:
    """Return the number of pixels of `mask`, a cut-out of an image, on the image's border."""
    sides = (
        (rows.start == 0, mask[0]),
        (rows.stop == shape[0], mask[-1]),
        (columns.start == 0, mask[:, 0]),
        (columns.stop == shape[1], mask[:, -1]),
    )
    return sum(int(side.sum()) for touches, side in sides if touches)
