"""Cutting a foreground where its depth has a step or its surface folds inward.

The objects of a household are mostly convex, so where one ends and another begins the surface
folds inward: a concave crease. Pixels of a crease go to the nearest piece afterwards.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from pipelines.configs import RegionConfig
from pipelines.geometry.organized import smooth_normals

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Labels = NDArray[np.int32]
Pixels = NDArray[np.int64]

USUAL_FOCAL = 525.0  # pixels; a coarser image is smoothed over fewer
GAP = 4  # pixels without depth that a surface is followed across
FINER = 0.5  # share of fold and step that too large a piece is cut at again


def segment(
    xyz: Array, foreground: Mask, clear: Mask, focal: float, config: RegionConfig
) -> tuple[Labels, Labels]:
    """Cut `foreground` (H, W) into pieces; 0 elsewhere.

    Pieces too large for an object are cut again at weaker creases and lower steps.

    Args:
        xyz: (H, W, 3) metres, camera frame, nan where missing.
        foreground: (H, W) what to cut.
        clear: (H, W) the part of it that pieces may hang together by.
        focal: pixels, focal length of the image.
        config: thresholds.

    Returns:
        The pieces (H, W), and (H, W) what hangs together without a step in depth.
    """
    rows, columns = np.nonzero(foreground)
    if not len(rows):
        return np.zeros(foreground.shape, np.int32), np.zeros(foreground.shape, np.int32)
    window = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    pieces, whole = np.zeros((2, *foreground.shape), np.int32)
    pieces[window], whole[window] = _segment(
        xyz[window], foreground[window], clear[window], focal, config
    )
    return pieces, whole


def _segment(
    xyz: Array, foreground: Mask, clear: Mask, focal: float, config: RegionConfig
) -> tuple[Labels, Labels]:
    fold = inward_fold(xyz, foreground, focal, config)
    whole = connected(xyz, foreground, config)
    fold[foreground & ~clear] = -np.inf
    labels = _cut(xyz, foreground, whole, fold, config)
    large = np.isin(labels, _too_large(xyz, labels, config)) & (labels > 0)
    if large.any():
        finer = replace(
            config,
            crease_fold=FINER * config.crease_fold,
            depth_step=FINER * config.depth_step,
        )
        again = _cut(xyz, large, connected(xyz, large, finer), fold, finer)
        labels = np.where(large, again + labels.max(initial=0), labels)
    return labels, whole


def _cut(xyz: Array, mask: Mask, whole: Labels, fold: Array, config: RegionConfig) -> Labels:
    parts = connected(xyz, mask & (fold > -config.crease_fold), config)
    big = np.bincount(parts.ravel()) >= config.min_pixels
    big[0] = False
    return _attach(xyz, np.where(big[parts], parts, 0), whole, mask)


def _too_large(xyz: Array, labels: Labels, config: RegionConfig) -> list[int]:
    counts = np.bincount(labels.ravel())
    found = np.flatnonzero(counts >= config.min_pixels)
    return [int(i) for i in found if i and extent(xyz[labels == i]) > config.max_extent]


def extent(points: Array) -> float:
    """Return the diagonal in metres of the box around `points` (n, 3), outliers left out."""
    low, high = np.percentile(points, [2, 98], axis=0)
    return float(np.linalg.norm(high - low))


def inward_fold(xyz: Array, mask: Mask, focal: float, config: RegionConfig) -> Array:
    """Return (H, W) how far the surface of `mask` folds: -2 sin(angle / 2) inward, 0 elsewhere.

    Normals on both sides of a convex edge point apart, of a concave one toward each other
    (Stein et al., LCCP): (n_2 - n_1) . (p_2 - p_1) / |p_2 - p_1| is then negative.
    """
    radius = max(2, round(config.normal_radius * min(1.0, focal / USUAL_FOCAL)))
    reach = radius + 1
    points = _padded(xyz, reach)
    normals = _padded(smooth_normals(xyz, mask, radius), reach)
    longest = config.crease_reach / focal * xyz[..., 2].astype(np.float32)
    deepest = np.zeros(mask.shape)
    for down, right in ((0, reach), (reach, 0), (reach, reach), (reach, -reach)):
        here, there = _ends_about(mask.shape, reach, down, right)
        line = points[there] - points[here]
        with np.errstate(invalid="ignore", divide="ignore"):
            length = np.sqrt(np.einsum("hwi,hwi->hw", line, line))
            fold = np.einsum("hwi,hwi->hw", normals[there] - normals[here], line) / length
            near = length < np.float32(np.hypot(down, right)) * longest
        np.minimum(deepest, np.where(near & np.isfinite(fold), fold, 0.0), out=deepest)
    return np.where(mask, deepest, 0.0)


def _padded(image: Array, margin: int) -> NDArray[np.float32]:
    width = ((margin, margin), (margin, margin), (0, 0))
    return np.pad(image.astype(np.float32), width, constant_values=np.nan)


def _ends_about(
    shape: tuple[int, ...], margin: int, down: int, right: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the slices of an image padded by `margin` that lie so far before and after it."""

    def moved(rows: int, columns: int) -> tuple[slice, slice]:
        first, second = margin + rows, margin + columns
        return slice(first, first + shape[0]), slice(second, second + shape[1])

    return moved(-down, -right), moved(down, right)


def connected(xyz: Array, mask: Mask, config: RegionConfig) -> Labels:
    """Label the pieces of `mask` (H, W) whose depth has no step; 0 elsewhere."""
    z = np.nan_to_num(xyz[..., 2]).astype(np.float32)
    missing = ~(z > 0)
    # Pixels at even places, what joins two neighbours between them: labelled as a picture.
    fine = np.zeros((2 * mask.shape[0] - 1, 2 * mask.shape[1] - 1), np.uint8)
    fine[::2, ::2] = mask
    for axis, between in ((0, fine[1::2, ::2]), (1, fine[::2, 1::2])):
        near, far = _ends(axis, 1)
        between[:] = mask[near] & mask[far] & _are_level(z[near], z[far], 1, config)
    count, labelled = cv2.connectedComponents(fine, connectivity=4)
    labels = np.asarray(labelled[::2, ::2], np.int32)
    pairs = []
    for axis in (0, 1):
        before, after = _at_gaps(mask, missing, axis)
        span = (after - before).sum(axis=0)
        joined = _are_level(z[tuple(before)], z[tuple(after)], span, config)
        pairs.append(np.stack([labels[tuple(each)] for each in (before, after)])[:, joined])
    row, column = np.concatenate(pairs, axis=1)
    graph = coo_matrix((np.ones(len(row), bool), (row, column)), (count, count))
    merged = connected_components(graph, directed=False)[1].astype(np.int32)
    return np.asarray(merged[labels])  # 0, which is in no pair, stays the first


def _are_level(
    near: NDArray[np.float32],
    far: NDArray[np.float32],
    span: int | Pixels,
    config: RegionConfig,
) -> Mask:
    """Return where depths that lie `span` pixels apart show no step."""
    step = config.depth_step * (1.0 + 0.25 * np.asarray(span, np.float32))
    return np.asarray(np.abs(near - far) < step * np.maximum(near, np.float32(0.5)))


def _at_gaps(mask: Mask, missing: Mask, axis: int) -> tuple[Pixels, Pixels]:
    """Return the pixels (2, n) of `mask` on both sides of gaps along `axis`, no wider than `GAP`.

    `missing`: (H, W) where nothing was measured.
    """
    near, far = _ends(axis, 1)
    start = np.stack(np.nonzero(mask[near] & missing[far]))
    along = np.array([[1], [0]] if axis == 0 else [[0], [1]])
    ends, size = start + along, mask.shape[axis]
    pairs = [np.zeros((2, 2, 0), np.int64)]
    for _ in range(2, GAP + 1):
        ends = ends + along
        inside = ends[axis] < size
        start, ends = start[:, inside], ends[:, inside]
        over = mask[tuple(ends)]
        pairs.append(np.stack([start[:, over], ends[:, over]]))
        still = missing[tuple(ends)]
        start, ends = start[:, still], ends[:, still]
    before, after = np.concatenate(pairs, axis=2)
    return before, after


def _ends(axis: int, span: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Return the slices of the pixels that have a partner `span` along `axis`, and of these."""
    keep, move = slice(None, -span), slice(span, None)
    return ((keep,), (move,)) if axis == 0 else ((slice(None), keep), (slice(None), move))


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
