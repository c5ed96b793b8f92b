"""Regions without a network: what stands on the table, cut where surfaces part or meet concavely.

A region is a connected piece of foreground whose depth has no step and no concave crease: the
objects of a household are mostly convex, so where one ends and another begins the surface folds
inward. Pixels of a crease go to the nearest region afterwards.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes, find_objects
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.organized import smooth_normals
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.tabletop import Tabletop, find_tabletop

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Labels = NDArray[np.int32]

WORKING_WIDTH = 640  # pixels; larger images are thinned to about this
GAP = 4  # pixels without depth that a surface is followed across


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
    labels = segment(xyz, top, config)
    scaled = [_enlarged(image, depth.shape) for image in (labels, top.foreground)]
    return GeometricRegions(scaled[0].astype(np.int32), top.plane, scaled[1].astype(bool))


def _enlarged(image: NDArray[np.generic], shape: tuple[int, ...]) -> Labels:
    if image.shape == shape:
        return image.astype(np.int32)
    size = (shape[1], shape[0])
    return np.asarray(
        cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_NEAREST), np.int32
    )


def segment(xyz: Array, top: Tabletop, config: RegionConfig) -> Labels:
    """Return the (H, W) labels 1, 2, ... of the regions of `top.foreground`, 0 elsewhere.

    `xyz`: (H, W, 3) metres, camera frame, nan where missing.
    """
    crease = concave_creases(xyz, top, config)
    parts = _connected(xyz, top.foreground & ~crease, config)
    sizes = np.bincount(parts.ravel())
    big = sizes >= config.min_pixels
    big[0] = False
    whole = _connected(xyz, top.foreground, config)
    labels = _attach(xyz, np.where(big[parts], parts, 0), whole, top.foreground)
    return _sound_regions(xyz, labels, top, config)


def concave_creases(xyz: Array, top: Tabletop, config: RegionConfig) -> Mask:
    """Return the (H, W) foreground pixels where the surface folds inward.

    Normals on both sides of a convex edge point apart, of a concave one toward each other
    (Stein et al., LCCP): (n_2 - n_1) . (p_2 - p_1) / |p_2 - p_1| is then negative.
    """
    normals = smooth_normals(xyz, top.foreground, config.normal_radius)
    reach = config.normal_radius + 1
    crease = np.zeros(top.foreground.shape, bool)
    for down, right in ((0, reach), (reach, 0), (reach, reach), (reach, -reach)):
        p, q = _shifted(xyz, -down, -right), _shifted(xyz, down, right)
        n, m = _shifted(normals, -down, -right), _shifted(normals, down, right)
        line = q - p
        with np.errstate(invalid="ignore"):
            length = np.linalg.norm(line, axis=-1)
            fold = np.einsum("hwi,hwi->hw", m - n, line) / length
            near = length < config.crease_reach * np.hypot(down, right) * xyz[..., 2] / 500.0
            crease |= near & (fold < -config.crease_fold)
    return crease & top.foreground


def _shifted(image: Array, down: int, right: int) -> Array:
    """Return `image` (H, W, c) moved so that pixel (v, u) holds (v + down, u + right)."""
    moved = np.full_like(image, np.nan)
    height, width = image.shape[:2]
    rows = slice(max(0, -down), min(height, height - down))
    columns = slice(max(0, -right), min(width, width - right))
    source_rows = slice(max(0, down), min(height, height + down))
    source_columns = slice(max(0, right), min(width, width + right))
    moved[rows, columns] = image[source_rows, source_columns]
    return moved


def _connected(xyz: Array, mask: Mask, config: RegionConfig) -> Labels:
    """Label the pieces of `mask` (H, W) whose depth has no step; 0 elsewhere."""
    index = np.full(mask.shape, -1, np.int64)
    index[mask] = np.arange(mask.sum())
    z = np.nan_to_num(xyz[..., 2])
    rows, columns = [], []
    for span in range(1, GAP + 1):
        for axis in (0, 1):
            near, far = _ends(axis, span)
            joined = mask[near] & mask[far]
            step = config.depth_step * np.maximum(z[near], 0.5) * (1 + 0.25 * span)
            joined &= np.abs(z[near] - z[far]) < step
            for between in range(1, span):  # only where nothing was measured between
                joined &= _between(z > 0, axis, span, between)
            rows.append(index[near][joined])
            columns.append(index[far][joined])
    row, column = np.concatenate(rows), np.concatenate(columns)
    size = int(mask.sum())
    graph = coo_matrix((np.ones(len(row), bool), (row, column)), (size, size))
    labels = np.zeros(mask.shape, np.int32)
    labels[mask] = connected_components(graph, directed=False)[1] + 1
    return labels


def _ends(axis: int, span: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Return the slices of the pixels that have a partner `span` along `axis`, and of these."""
    keep, move = slice(None, -span), slice(span, None)
    return ((keep,), (move,)) if axis == 0 else ((slice(None), keep), (slice(None), move))


def _between(measured: Mask, axis: int, span: int, offset: int) -> Mask:
    length = measured.shape[axis] - span
    taken = np.take(measured, np.arange(offset, offset + length), axis=axis)
    return np.asarray(~taken)


def _attach(xyz: Array, cores: Labels, whole: Labels, foreground: Mask) -> Labels:
    """Give the foreground outside `cores` to the nearest core of the same whole piece.

    A whole piece without a core (small or thin) becomes a region of its own.
    """
    labels = cores.copy()
    rest = foreground & (cores == 0)
    with_core = np.zeros(whole.max(initial=0) + 1, bool)
    with_core[whole[cores > 0]] = True
    loose = rest & ~with_core[whole]
    labels[loose] = cores.max(initial=0) + whole[loose]
    rest &= ~loose
    if rest.any():
        seeds = cv2.dilate(rest.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
        seeds &= cores > 0
        if seeds.any():
            _, nearest = KDTree(xyz[seeds]).query(xyz[rest])
            labels[rest] = cores[seeds][nearest]
    return labels


def _sound_regions(xyz: Array, labels: Labels, top: Tabletop, config: RegionConfig) -> Labels:
    """Renumber the regions that may be objects, holes filled, nearest first; drop the others."""
    kept: list[tuple[float, Mask, tuple[slice, slice]]] = []
    names, compact = np.unique(labels, return_inverse=True)
    compact = compact.reshape(labels.shape) if names[0] == 0 else compact.reshape(labels.shape) + 1
    for index, box in enumerate(find_objects(compact), 1):
        if box is None:
            continue
        mask = compact[box] == index
        points = xyz[box][mask]
        if _may_be_object(mask, points, box, labels.shape, top, config):
            filled = binary_fill_holes(mask) & ((compact[box] == 0) | mask)
            kept.append((float(np.median(points[:, 2])), filled, box))
    result = np.zeros(labels.shape, np.int32)
    for number, (_, mask, box) in enumerate(sorted(kept, key=lambda entry: entry[0]), 1):
        result[box][mask] = number
    return result


def _may_be_object(
    mask: Mask,
    points: Array,
    box: tuple[slice, slice],
    shape: tuple[int, ...],
    top: Tabletop,
    config: RegionConfig,
) -> bool:
    if mask.sum() < config.min_pixels:
        return False
    low, high = np.percentile(points, [2, 98], axis=0)
    if np.linalg.norm(high - low) > config.max_extent:
        return False
    if top.plane is None:
        return True
    tall = np.percentile(top.plane.height(points), 90)
    return bool(tall > 1.5 * config.min_height)
