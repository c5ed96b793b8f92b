"""Regions without a network: pieces of what stands on the table that may be objects."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes, find_objects

from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.depth_segments import extent, segment
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.tabletop import Tabletop, find_tabletop

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Labels = NDArray[np.int32]

WORKING_WIDTH = 640  # pixels; larger images are thinned to about this
FOOT = 6  # pixels below and above a piece where something nearer may hide its foot
TALL = 1.7  # heights that stand out from noise which an object's highest part must reach
MIN_BORDER = 20  # pixels on the picture's border that say a thing goes on outside


@dataclass(frozen=True)
class GeometricRegions:
    """Regions of one frame.

    Attributes:
        labels: (H, W) 1, 2, ... for regions, 0 elsewhere.
        plane: the support plane, camera frame, normal to the camera's side; None without one.
        foreground: (H, W) what is above the plane, in a region or not.
    """

    labels: Labels
    plane: Plane | None
    foreground: Mask

    @property
    def masks(self) -> list[Mask]:
        """The regions one by one, (H, W) each."""
        return [self.labels == index for index in range(1, int(self.labels.max(initial=0)) + 1)]


def geometric_regions(
    depth: NDArray[np.floating],
    intrinsics: Intrinsics,
    config: RegionConfig,
    rng: np.random.Generator,
) -> GeometricRegions:
    """Find the regions of `depth` (H, W) metres, 0 where missing."""
    step = max(1, round(depth.shape[1] / WORKING_WIDTH))
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
    top = find_tabletop(xyz, camera, config, rng)
    pieces, whole = segment(xyz, top.foreground, top.clear, camera.fx, config)
    labels = _sound_regions(xyz, pieces, whole, top, config)
    scaled = [_enlarged(image, depth.shape) for image in (labels, top.foreground)]
    return GeometricRegions(scaled[0].astype(np.int32), top.plane, scaled[1].astype(bool))


def _enlarged(image: NDArray[np.generic], shape: tuple[int, ...]) -> Labels:
    if image.shape == shape:
        return image.astype(np.int32)
    size = (shape[1], shape[0])
    return np.asarray(
        cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_NEAREST), np.int32
    )


def _sound_regions(
    xyz: Array, labels: Labels, whole: Labels, top: Tabletop, config: RegionConfig
) -> Labels:
    """Renumber the regions that may be objects, holes filled, nearest first; drop the others."""
    kept: list[tuple[float, Mask, tuple[slice, slice]]] = []
    standing = _standing(xyz, whole, top, config)
    names = np.flatnonzero(np.bincount(labels.ravel()))
    place = np.zeros(int(names[-1]) + 1, np.int32)  # labels may have gaps, boxes must not
    place[names[names > 0]] = np.arange(1, np.count_nonzero(names) + 1)
    compact = place[labels]
    for index, box in enumerate(find_objects(compact), 1):
        rows, columns = box
        mask = compact[rows, columns] == index
        points = xyz[rows, columns][mask]
        if mask.sum() < config.min_pixels or not standing[whole[rows, columns][mask][0]]:
            continue
        if _may_be_object(points, _border_pixels(mask, rows, columns, labels.shape), top, config):
            filled = binary_fill_holes(mask) & ((compact[rows, columns] == 0) | mask)
            kept.append((float(np.median(points[:, 2])), filled, (rows, columns)))
    result = np.zeros(labels.shape, np.int32)
    for number, (_, mask, box) in enumerate(sorted(kept, key=lambda entry: entry[0]), 1):
        result[box][mask] = number
    return result


def _standing(xyz: Array, whole: Labels, top: Tabletop, config: RegionConfig) -> Mask:
    """Return (pieces + 1,) which connected pieces come down to the table.

    One whose foot is hidden behind a nearer piece may; an arm that hangs into the picture or
    what is seen beyond the table does not.
    """
    count = int(whole.max(initial=0))
    result = np.ones(count + 1, bool)
    if top.plane is None:
        return result
    z = xyz[..., 2]
    for index, box in enumerate(find_objects(whole), 1):
        mask = whole[box] == index
        if np.count_nonzero(mask) < config.min_pixels:
            continue
        if np.percentile(top.plane.height(xyz[box][mask]), 2) < config.max_floating:
            continue
        grown = tuple(slice(max(0, s.start - FOOT), s.stop + FOOT) for s in box)
        inside = whole[grown] == index
        below = cv2.dilate(inside.astype(np.uint8), np.ones((2 * FOOT + 1, 1), np.uint8)) > 0
        neighbour = below & ~inside & (whole[grown] > 0)
        hidden = neighbour & (z[grown] < np.median(z[box][mask]))
        result[index] = hidden.sum() > FOOT * 0.3 * np.count_nonzero(inside.any(axis=0))
    return result


def _border_pixels(mask: Mask, rows: slice, columns: slice, shape: tuple[int, ...]) -> int:
    """Return how many pixels of `mask`, a cut-out of an image, lie on the image's border."""
    sides = (
        (rows.start == 0, mask[0]),
        (rows.stop == shape[0], mask[-1]),
        (columns.start == 0, mask[:, 0]),
        (columns.stop == shape[1], mask[:, -1]),
    )
    return sum(int(side.sum()) for touches, side in sides if touches)


def _may_be_object(points: Array, border_pixels: int, top: Tabletop, config: RegionConfig) -> bool:
    """Return whether the region of `points` (n, 3) is of an object's size and place."""
    size = extent(points)
    if size > config.max_extent:
        return False
    # A strip along the picture's border, or a big thing that reaches in from outside.
    if border_pixels**2 > config.max_border * len(points):
        return False
    if border_pixels > MIN_BORDER and size > config.max_cut_extent:
        return False
    if top.plane is None:
        return True
    tall = np.percentile(top.plane.height(points), 90)
    return bool(tall > TALL * top.threshold(np.median(points[:, 2]), config))
