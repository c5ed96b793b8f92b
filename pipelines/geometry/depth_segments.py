"""Cutting a foreground where its depth has a step or its surface folds inward.

The objects of a household are mostly convex, so where one ends and another begins the surface
folds inward: a concave crease. Pixels of a crease go to the nearest piece afterwards.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from pipelines.configs import RegionConfig
from pipelines.geometry.organized import normals_at

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Labels = NDArray[np.int32]
Pixels = NDArray[np.int64]
Image = NDArray[np.float32]
Window = tuple[slice, slice]

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
    large = _too_large(xyz, labels, config).take(labels)
    if large.any():
        finer = replace(
            config,
            crease_fold=FINER * config.crease_fold,
            depth_step=FINER * config.depth_step,
        )
        again = _cut(xyz, large, connected(xyz, large, finer), fold, finer)
        labels = np.where(large, again + labels.max(initial=0), labels)
    return labels, whole


def _cut(xyz: Array, mask: Mask, whole: Labels, fold: Image, config: RegionConfig) -> Labels:
    parts = connected(xyz, mask & (fold > -config.crease_fold), config)
    names = np.arange(parts.max(initial=0) + 1, dtype=np.int32)
    names[np.bincount(parts.ravel()) < config.min_pixels] = 0
    names[0] = 0
    return _attach(xyz, names.take(parts), whole, mask)


def _too_large(xyz: Array, labels: Labels, config: RegionConfig) -> Mask:
    """Return (labels + 1,) which pieces are longer than an object; 0, which is none, is not."""
    large = np.bincount(labels.ravel()) >= config.min_pixels
    large[0] = False
    boxes = find_objects(labels)
    for label in np.flatnonzero(large):
        box = boxes[label - 1]
        inside = labels[box] == label
        points = np.stack([xyz[box][..., axis][inside] for axis in range(3)])
        # Quicker than the extent, which is never more.
        large[label] = (
            np.linalg.norm(np.ptp(points, axis=1)) > config.max_extent
            and extent(points.T) > config.max_extent
        )
    return large


def extent(points: Array) -> float:
    """Return the diagonal in metres of the box around `points` (n, 3), outliers left out."""
    low, high = np.percentile(points, [2, 98], axis=0)
    return float(np.linalg.norm(high - low))


def inward_fold(xyz: Array, mask: Mask, focal: float, config: RegionConfig) -> Image:
    """Return (H, W) how far the surface of `mask` folds: -2 sin(angle / 2) inward, 0 elsewhere.

    Normals on both sides of a convex edge point apart, of a concave one toward each other
    (Stein et al., LCCP): (n_2 - n_1) . (p_2 - p_1) / |p_2 - p_1| is then negative.
    """
    radius = max(2, round(config.normal_radius * min(1.0, focal / USUAL_FOCAL)))
    reach = radius + 1
    known = mask & np.isfinite(xyz[..., 2])
    points = _padded([xyz[..., axis][known] for axis in range(3)], known, reach)
    normals = _padded(normals_at(xyz, known, radius), known, reach)
    longest = config.crease_reach / focal * xyz[..., 2].astype(np.float32)
    deepest = np.zeros(mask.shape, np.float32)
    for down, right in ((0, reach), (reach, 0), (reach, reach), (reach, -reach)):
        here, there = _ends_about(mask.shape, reach, down, right)
        line = _differences(points, here, there)
        fold = _dot(_differences(normals, here, there), line)
        length = np.sqrt(_dot(line, line))
        with np.errstate(invalid="ignore", divide="ignore"):
            fold /= length
            fold[~(length < np.float32(np.hypot(down, right)) * longest)] = 0.0
        np.fmin(deepest, fold, out=deepest)  # nan where a normal is missing
    return np.where(mask, deepest, np.float32(0.0))


def _padded(values: list[Array], known: Mask, margin: int) -> list[Image]:
    """Return images of `values` (n,) at `known` (H, W), nan elsewhere and in a margin about it."""
    images = []
    for axis in values:
        image = np.full(np.add(known.shape, 2 * margin), np.nan, np.float32)
        image[margin:-margin, margin:-margin][known] = axis
        images.append(image)
    return images


def _differences(images: list[Image], here: Window, there: Window) -> list[Image]:
    return [image[there] - image[here] for image in images]


def _dot(first: list[Image], second: list[Image]) -> Image:
    # An axis at a time, each in one piece: half the time of rows of three.
    total = first[0] * second[0]
    for one, other in zip(first[1:], second[1:], strict=True):
        total += one * other
    return total


def _ends_about(
    shape: tuple[int, ...], margin: int, down: int, right: int
) -> tuple[Window, Window]:
    """Return the slices of an image padded by `margin` that lie so far before and after it."""

    def moved(rows: int, columns: int) -> Window:
        first, second = margin + rows, margin + columns
        return slice(first, first + shape[0]), slice(second, second + shape[1])

    return moved(-down, -right), moved(down, right)


def connected(xyz: Array, mask: Mask, config: RegionConfig) -> Labels:
    """Label the pieces of `mask` (H, W), all measured, whose depth has no step; 0 elsewhere."""
    z = xyz[..., 2].astype(np.float32)
    # Pixels at even places, what joins two neighbours between them: labelled as a picture.
    fine = np.zeros((2 * mask.shape[0] - 1, 2 * mask.shape[1] - 1), np.uint8)
    fine[::2, ::2] = mask
    for axis, between in ((0, fine[1::2, ::2]), (1, fine[::2, 1::2])):
        near, far = _ends(axis)
        between[:] = mask[near] & mask[far] & _are_level(z[near], z[far], 1, config)
    # What is usual for four neighbours takes twice as long.
    count, labelled = cv2.connectedComponentsWithAlgorithm(fine, 4, cv2.CV_32S, cv2.CCL_SAUF)
    labels = np.asarray(labelled[::2, ::2], np.int32)
    before, after, span = np.concatenate([_at_gaps(mask, ~(z > 0), axis) for axis in (0, 1)], 1)
    level = _are_level(z.take(before), z.take(after), span, config)
    ends = labels.take(before[level]), labels.take(after[level])
    graph = coo_matrix((np.ones(len(ends[0]), bool), ends), (count, count))
    merged = connected_components(graph, directed=False)[1].astype(np.int32)
    return np.asarray(merged.take(labels))  # 0, which is in no pair, stays the first


def _are_level(
    near: NDArray[np.float32],
    far: NDArray[np.float32],
    span: int | Pixels,
    config: RegionConfig,
) -> Mask:
    """Return where depths that lie `span` pixels apart show no step."""
    step = config.depth_step * (1.0 + 0.25 * np.asarray(span, np.float32))
    return np.asarray(np.abs(near - far) < step * np.maximum(near, np.float32(0.5)))


def _at_gaps(mask: Mask, missing: Mask, axis: int) -> Pixels:
    """Return pixels of `mask` before and after gaps along `axis`, and how far apart: (3, n).

    Gaps are no wider than `GAP`. Pixels are counted row by row.
    `missing`: (H, W) where nothing was measured.
    """
    near, far = _ends(axis)
    open_ended = np.zeros(mask.shape, bool)
    open_ended[near] = mask[near] & missing[far]
    start = np.flatnonzero(open_ended)
    width = mask.shape[1]
    room = mask.shape[axis] - 1 - (start // width if axis == 0 else start % width)
    along = width if axis == 0 else 1
    pairs = [np.zeros((3, 0), np.int64)]
    for span in range(2, GAP + 1):
        start, room = start[room >= span], room[room >= span]
        end = start + span * along
        over = mask.take(end)
        pairs.append(np.stack([start[over], end[over], np.full(np.count_nonzero(over), span)]))
        still = missing.take(end)
        start, room = start[still], room[still]
    return np.concatenate(pairs, axis=1)


def _ends(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Return the slices of the pixels that have a next one along `axis`, and of the next ones."""
    keep, move = slice(None, -1), slice(1, None)
    return ((keep,), (move,)) if axis == 0 else ((slice(None), keep), (slice(None), move))


def _attach(xyz: Array, cores: Labels, whole: Labels, foreground: Mask) -> Labels:
    """Give the foreground outside `cores` to the nearest core of the same whole piece.

    A whole piece without a core (small or thin) becomes a region of its own.
    """
    labels = cores.copy()
    rest = foreground & (cores == 0)
    with_core = np.zeros(whole.max(initial=0) + 1, bool)
    with_core[whole[cores > 0]] = True
    pieces = whole[rest]
    labels[rest] = np.where(with_core[pieces], 0, cores.max(initial=0) + pieces)
    rest &= labels == 0
    if rest.any():
        seeds = cv2.dilate(rest.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
        seeds &= cores > 0
        if seeds.any():
            _, nearest = KDTree(xyz[seeds]).query(xyz[rest])
            labels[rest] = cores[seeds][nearest]
    return labels
