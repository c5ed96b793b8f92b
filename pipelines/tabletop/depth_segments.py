"""Segmentation of a foreground at depth steps and concave creases.

Household objects are mostly convex: where one ends and another begins, the surface folds inward.
The pixels of such a crease go to the nearest piece afterwards.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.configs import RegionConfig
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import quantiles
from pipelines.tabletop.organized import smooth_normals

Labels = NDArray[np.int32]
Axes = tuple[Singles, Singles, Singles]

USUAL_FOCAL = 525.0  # pixels; normals of a coarser image are fitted to fewer pixels
BULK_ENDS = (0.02, 0.98)  # quantiles of points along a direction, without outliers
GAP = 4  # pixels from one pixel of a surface to the next, if those between lack depth
GAP_SLACK = 0.25  # share by which the allowed step grows with each pixel of the gap
NEAREST_STEP = 0.5  # metres; nearer surfaces are allowed the step of this depth
FINER = 0.5  # factor of the thresholds of fold and step when too large a piece is cut again


def segment(
    xyz: Array, foreground: Mask, clear: Mask, focal: float, config: RegionConfig
) -> tuple[Labels, Labels]:
    """Cut `foreground` (H, W) into pieces, at depth steps and creases; 0 elsewhere.

    Pieces too large for an object are cut again at weaker creases and lower steps.

    Args:
        xyz: (H, W, 3) metres, camera frame, nan where missing.
        foreground: (H, W) pixels to cut.
        clear: (H, W) foreground pixels that may connect a piece.
        focal: focal length of the image, pixels.
        config: thresholds.

    Returns:
        The pieces (H, W), and the surfaces (H, W), which only depth steps separate.
    """
    pieces, surfaces = np.zeros((2, *foreground.shape), np.int32)
    if not foreground.any():
        return pieces, surfaces
    rows, columns = (np.flatnonzero(foreground.any(axis=axis)) for axis in (1, 0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    xyz, foreground = np.ascontiguousarray(xyz[window]), foreground[window]
    fold = inward_fold(xyz, foreground, focal, config)
    surfaces[window] = connected(xyz, foreground, config)
    fold[foreground & ~clear[window]] = -np.inf
    labels = _cut(xyz, foreground, surfaces[window], fold, config)
    large = _too_large(xyz, labels, config).take(labels)
    if large.any():
        finer = replace(
            config, crease_fold=FINER * config.crease_fold, depth_step=FINER * config.depth_step
        )
        again = _cut(xyz, large, connected(xyz, large, finer), fold, finer)
        labels = np.where(large, again + labels.max(initial=0), labels)
    pieces[window] = labels
    return pieces, surfaces


def _cut(xyz: Array, mask: Mask, surfaces: Labels, fold: Singles, config: RegionConfig) -> Labels:
    """Return the pieces (H, W) of `mask` (H, W), cut where `fold` (H, W) is a crease."""
    parts = connected(xyz, mask & (fold > -config.crease_fold), config)
    names = np.arange(parts.max(initial=0) + 1, dtype=np.int32)
    names[np.bincount(parts.ravel()) < config.min_pixels] = 0
    names[0] = 0
    return _attach(xyz, names.take(parts), surfaces, mask)


def _too_large(xyz: Array, labels: Labels, config: RegionConfig) -> Mask:
    """Return a mask (labels + 1,) of the pieces longer than an object; label 0 is no piece."""
    size, low, high = _boxes(np.ascontiguousarray(xyz), labels, int(labels.max(initial=0)))
    # The diagonal is a cheap upper bound of the extent.
    large = (size >= config.min_pixels) & (np.linalg.norm(high - low, axis=1) > config.max_extent)
    large[0] = False
    for label in np.flatnonzero(large):
        large[label] = extent(xyz[labels == label]) > config.max_extent
    return np.asarray(large)


def extent(points: Array) -> float:
    """Return the diagonal of the box around `points` (n, 3) without outliers, metres."""
    low, high = quantiles(points.T, BULK_ENDS).T
    return float(np.linalg.norm(high - low))


def inward_fold(xyz: Array, mask: Mask, focal: float, config: RegionConfig) -> Singles:
    """Return the inward fold (H, W) of the surface of `mask`: -2 sin(angle / 2), 0 where convex.

    The normals on both sides of a convex edge point apart, normals at a concave edge toward each
    other (Stein et al., LCCP): (n_2 - n_1) . (p_2 - p_1) / |p_2 - p_1| is then negative. `xyz`:
    (H, W, 3) metres, camera frame, nan where missing.
    """
    radius = max(2, round(config.normal_radius * min(1.0, focal / USUAL_FOCAL)))
    reach = radius + 1
    ends = np.array([(0, reach), (reach, 0), (reach, reach), (reach, -reach)])
    # Longest chords of a surface without a step, at a depth of one metre.
    longest = np.hypot(*ends.T).astype(np.float32) * np.float32(config.crease_reach / focal)
    xyz, mask = np.ascontiguousarray(xyz), np.ascontiguousarray(mask)
    return _folds(xyz, smooth_normals(xyz, mask, radius), mask, ends, longest)


def connected(xyz: Array, mask: Mask, config: RegionConfig) -> Labels:
    """Label the surfaces of `mask` (H, W), whose pixels are all measured; 0 elsewhere.

    A surface has no step in depth. It continues along rows and columns to pixels up to `GAP` apart
    without depth between. Surfaces are numbered row by row. `xyz`: as in `inward_fold`.
    """
    steps = config.depth_step * (1.0 + GAP_SLACK * np.arange(GAP + 1, dtype=np.float32))
    return _joined(xyz[..., 2].astype(np.float32), np.ascontiguousarray(mask), steps)


def _attach(xyz: Array, cores: Labels, surfaces: Labels, foreground: Mask) -> Labels:
    """Label the foreground outside `cores` by the nearest of the cores next to such pixels.

    A surface with cores only across a gap takes the nearest of its own. A surface without a core
    (small or thin) becomes a separate piece.
    """
    labels = cores.copy()
    rest = foreground & (cores == 0)
    with_core = np.zeros(surfaces.max(initial=0) + 1, bool)
    with_core[surfaces[cores > 0]] = True
    around = surfaces[rest]
    labels[rest] = np.where(with_core[around], 0, cores.max(initial=0) + around)
    rest &= labels == 0
    seeds = cv2.dilate(rest.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    seeds &= cores > 0
    seeded = np.zeros(len(with_core), bool)
    seeded[surfaces[seeds]] = True
    apart = rest & ~seeded.take(surfaces)
    for surface in np.unique(surfaces[apart]):
        own = surfaces == surface
        _label_by_nearest(labels, xyz, apart & own, own & (cores > 0))
    _label_by_nearest(labels, xyz, rest & ~apart, seeds)
    return labels


def _label_by_nearest(labels: Labels, xyz: Array, some: Mask, seeds: Mask) -> None:
    """Give the pixels `some` (H, W) the labels of the nearest of the pixels `seeds` (H, W)."""
    if some.any():
        _, nearest = KDTree(xyz[seeds]).query(xyz[some])
        labels[some] = labels[seeds][nearest]


@compiled
def _folds(xyz: Array, normals: Array, mask: Mask, ends: Indices, longest: Singles) -> Singles:
    """Return the most negative fold (H, W) between the ends of k chords through each pixel.

    `ends`: (k, 2) rows and columns from a chord's middle to its end. `longest`: (k,) lengths
    at a depth of one metre beyond which a chord crosses a step.
    """
    height, width = mask.shape
    margin = int(ends.max())
    points, facing = _padded(xyz, mask, margin), _padded(normals, mask, margin)
    folds, stride = np.zeros((height, width), np.float32), width + 2 * margin
    for row in range(height):
        first = (row + margin) * stride + margin
        for k in range(len(ends)):
            end = ends[k, 0] * stride + ends[k, 1]
            _lower(
                folds[row],
                _row(points, first, width)[2],
                (_row(points, first - end, width), _row(points, first + end, width)),
                (_row(facing, first - end, width), _row(facing, first + end, width)),
                longest[k],
            )
    return folds


@compiled
def _padded(image: Array, mask: Mask, margin: int) -> Axes:
    """Return flat x, y and z of `image` (H, W, 3), with a margin; nan there and outside `mask`."""
    height, width = mask.shape
    stride = width + 2 * margin
    x = np.full((height + 2 * margin) * stride, np.nan, np.float32)
    y, z = x.copy(), x.copy()
    for row in range(height):
        for column in range(width):
            if mask[row, column]:
                n = (row + margin) * stride + column + margin
                x[n] = image[row, column, 0]
                y[n] = image[row, column, 1]
                z[n] = image[row, column, 2]
    return x, y, z


@compiled
def _row(axes: Axes, first: int, width: int) -> Axes:
    end = first + width
    return axes[0][first:end], axes[1][first:end], axes[2][first:end]


@compiled
def _lower(
    folds: Singles,
    z: Singles,
    points: tuple[Axes, Axes],
    normals: tuple[Axes, Axes],
    longest: float,
) -> None:
    """Lower `folds` (W,) to the folds between two rows of points, unless the chord is too long."""
    # Without branches the loop is vectorised; nan never compares as lower.
    (x0, y0, z0), (x1, y1, z1) = points
    (u0, v0, w0), (u1, v1, w1) = normals
    for n in range(len(folds)):
        x, y, depth = x1[n] - x0[n], y1[n] - y0[n], z1[n] - z0[n]
        length = np.sqrt(x * x + y * y + depth * depth)
        total = x * (u1[n] - u0[n]) + y * (v1[n] - v0[n]) + depth * (w1[n] - w0[n])
        fold = total / length if length < longest * z[n] else np.float32(0.0)
        folds[n] = fold if fold < folds[n] else folds[n]


@compiled
def _joined(z: Singles, mask: Mask, steps: Singles) -> Labels:
    """Return the surfaces of `connected`; `steps` (GAP + 1,): least step of pixels n apart."""
    height, width = mask.shape
    depth, inside = z.ravel(), mask.ravel()
    # Union-find: the number of each run along a row, and an earlier run of the same surface.
    run, earlier, count = np.zeros(mask.size, np.int64), np.zeros(mask.size + 1, np.int64), 0
    apart = np.array([1, width])  # flat distance of neighbours along a row and along a column
    for row in range(height):
        for column in range(width):
            pixel = row * width + column
            if not inside[pixel]:
                continue
            left = _before(depth, inside, steps, (pixel, column), apart[0])
            over = _before(depth, inside, steps, (pixel, row), apart[1])
            if left < 0:
                count += 1
                earlier[count] = count
            run[pixel] = run[left] if left >= 0 else count
            if over >= 0 and earlier[run[over]] != earlier[run[pixel]]:
                one = _first(earlier, int(run[over]))
                other = _first(earlier, int(run[pixel]))
                earlier[max(one, other)] = min(one, other)
    label, found = np.zeros(count + 1, np.int32), 0
    for n in range(1, count + 1):
        first = _first(earlier, n)
        found += first == n
        label[n] = found if first == n else label[first]
    return label[run].reshape(height, width)


@compiled
def _before(z: Singles, inside: Mask, steps: Singles, at: tuple[int, int], along: int) -> int:
    """Return the previous pixel on the same surface, -1 if there is none.

    `at`: the flat pixel, and the number of pixels before it, `along` apart.
    """
    pixel, room = at
    for span in range(1, min(len(steps), room + 1)):
        other = pixel - span * along
        if inside[other]:
            step = steps[span] * max(z[other], np.float32(NEAREST_STEP))
            return other if abs(z[pixel] - z[other]) < step else -1
        if z[other] > 0:
            return -1
    return -1


@compiled
def _first(earlier: Indices, run: int) -> int:
    """Return the first of the runs that are joined with `run`."""
    while earlier[run] != run:
        earlier[run] = earlier[earlier[run]]
        run = int(earlier[run])
    return run


@compiled
def _boxes(xyz: Array, labels: Labels, count: int) -> tuple[Indices, Array, Array]:
    """Return pixel counts, and low and high corners (n, 3), metres, of labels 0 to `count`."""
    size = np.zeros(count + 1, np.int64)
    low, high = np.full((count + 1, 3), np.inf), np.full((count + 1, 3), -np.inf)
    for row in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            label = labels[row, column]
            if label == 0:
                continue
            size[label] += 1
            for axis in range(3):
                value = xyz[row, column, axis]
                low[label, axis] = min(low[label, axis], value)
                high[label, axis] = max(high[label, axis], value)
    return size, low, high
