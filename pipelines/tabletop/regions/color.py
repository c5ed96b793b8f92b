"""Pieces that stand out from a table by colour: thin objects, and objects without depth.

The colour of a bare table changes slowly over the image, with the light. A pixel stands out if
its colour differs from the mean of the bare table around it by more than the table's own pattern.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask, Singles
from pipelines.configs import ColorConfig
from pipelines.geometry.numerics.compiled import compiled
from pipelines.tabletop.depth_segments import Labels
from pipelines.tabletop.organized import Bytes
from pipelines.tabletop.support_plane import LARGE_PART, SHADOW_GAPS

THINNED = 4  # rows and columns of an image from which the table's colour is taken
# Standard deviations beyond which pixels are left out of the mean colour, in each pass. With k, an
# object over up to 1 / (1 + k^2) of a window is distinguished from the table's pattern.
OUTLIERS = (1.5, 2.5, np.inf)
LEAST_SPREAD = 1.6  # Lab, of the table's colour: noise of a camera
NOTHING_SEEN = np.float32(1e-6)  # replaces a share of zero as a divisor
LEAST_SEEN = 0.02  # share of a window that must be bare table
LIGHTNESS_UNITS = 255.0 / 100.0  # of OpenCV's 8-bit Lab
RIM = 5  # pixels along the outline of a table in which its edge may stand out
SQUARE = np.ones((3, 3), np.uint8)
CROSS = np.asarray(cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)), np.uint8)
DISC = np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)), np.uint8)


@dataclass(frozen=True)
class ColorPieces:
    """Pieces that differ in colour from the table.

    Attributes:
        labels: (H, W) 1, 2, ... n for pieces, 0 elsewhere.
        may_be_object: (n + 1,) whether a piece may be an object: inside the table's outline,
            and no line such as a cable or a joint of boards; False for label 0.
    """

    labels: Labels
    may_be_object: Mask


def color_pieces(color: Bytes, bare: Mask, config: ColorConfig) -> ColorPieces:
    """Return the pieces of `color` (H, W, 3), RGB, that differ from the table's colour.

    `bare`: (H, W) pixels measured on the table.
    """
    outline = table_outline(bare)
    if not outline.any():
        return ColorPieces(np.zeros(bare.shape, np.int32), np.zeros(1, np.bool_))
    lab = np.asarray(cv2.cvtColor(np.ascontiguousarray(color), cv2.COLOR_RGB2LAB), np.uint8)
    lightness = config.lightness_weight / LIGHTNESS_UNITS
    mean, spread = _table_color(lab, bare, lightness, config)
    least = np.maximum(np.float32(config.min_contrast), np.float32(config.deviations) * spread)
    differs = _differing(lab, mean, least, outline, lightness)
    closed = cv2.morphologyEx(differs, cv2.MORPH_CLOSE, SQUARE)
    parts = cv2.morphologyEx(closed, cv2.MORPH_OPEN, CROSS)
    return _pieces(np.asarray(parts, np.uint8), outline, config)


def _pieces(parts: Bytes, outline: Bytes, config: ColorConfig) -> ColorPieces:
    """Return the pieces of `parts` (H, W), 1 or 0, within the table's `outline` (H, W).

    Cables are removed, which separates the objects that they join.
    """
    count, labels, area = _connected(parts)
    slender = _lengths(parts, labels, count) ** 2 > config.max_slenderness * area
    slender[0] = False
    if slender.any():
        lines = slender.take(labels).view(np.uint8)
        thick = np.asarray(cv2.morphologyEx(lines, cv2.MORPH_OPEN, DISC), np.uint8)
        parts = np.where(lines > 0, thick, parts)
        count, labels, area = _connected(parts)
    rim = outline - cv2.erode(outline, np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8))
    at_rim = np.bincount(labels[rim > 0], minlength=count)
    half = np.asarray(cv2.distanceTransform(parts, cv2.DIST_L2, 3), np.float32)
    widest = 2.0 * _largest(half, labels, count)
    kept = area >= config.min_pixels
    kept[0] = False
    numbers = np.where(kept, np.cumsum(kept), 0).astype(np.int32)
    is_whole = (at_rim == 0) & (widest >= config.min_thickness)
    return ColorPieces(numbers.take(labels), np.concatenate([[False], is_whole[kept]]))


def _lengths(parts: Bytes, labels: Labels, count: int) -> Array:
    """Return half the number (count,) of border pixels of the pieces `labels`."""
    inner = np.asarray(cv2.erode(parts, SQUARE), np.uint8)
    return np.bincount(labels[parts > inner], minlength=count) / 2.0


def _connected(parts: Bytes) -> tuple[int, Labels, NDArray[np.int32]]:
    """Return the number of labels including 0, the labels (H, W), and their pixel counts (n,)."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(parts, connectivity=8)
    return count, np.asarray(labels, np.int32), np.asarray(stats, np.int32)[:, cv2.CC_STAT_AREA]


def table_outline(bare: Mask) -> Bytes:
    """Return the convex outline (H, W), 1 inside, of the large parts of a table's `bare` pixels."""
    outline = np.zeros(bare.shape, np.uint8)
    closed = cv2.morphologyEx(bare.astype(np.uint8), cv2.MORPH_CLOSE, SHADOW_GAPS)
    parts, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    areas = [cv2.contourArea(part) for part in parts]
    large = [
        part for part, area in zip(parts, areas, strict=True) if area > LARGE_PART * max(areas)
    ]
    if large:
        cv2.fillConvexPoly(outline, cv2.convexHull(np.concatenate(large)), 1)
    return outline


def _table_color(
    lab: Bytes, bare: Mask, lightness: float, config: ColorConfig
) -> tuple[Singles, Singles]:
    """Return the table's mean colour (H, W, 3), Lab, and its standard deviation (H, W).

    `lightness`: factor of the first channel in both results. The deviation is infinite where no
    bare table is near.
    """
    height, width = bare.shape
    size = max(1, width // THINNED), max(1, height // THINNED)
    seen = cv2.erode(bare.astype(np.uint8), SQUARE)
    weight = cv2.resize(seen, size, interpolation=cv2.INTER_NEAREST).astype(np.float32)
    small = cv2.resize(lab, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    small[..., 0] *= lightness
    side = max(3, round(config.window * size[0]) | 1)

    def around(values: Singles) -> Singles:
        return np.asarray(cv2.boxFilter(values, -1, (side, side)), np.float32)

    for outlier in OUTLIERS:
        share = np.maximum(around(weight), NOTHING_SEEN)
        mean = around(small * weight[..., None]) / share[..., None]
        squares = ((small - mean) ** 2).sum(axis=-1)
        variance = np.maximum(around(squares * weight) / share, LEAST_SPREAD**2)
        known = share > LEAST_SEEN
        weight = weight * (squares < outlier**2 * variance)
    spread = np.where(known, np.sqrt(variance), np.float32(np.inf)).astype(np.float32)
    full = width, height
    return (
        np.asarray(cv2.resize(mean, full), np.float32),
        np.asarray(cv2.resize(spread, full, interpolation=cv2.INTER_NEAREST), np.float32),
    )


@compiled
def _differing(lab: Bytes, mean: Singles, least: Singles, inside: Bytes, lightness: float) -> Bytes:
    """Return the pixels (H, W), 1 or 0, `inside` whose colour is at least `least` from `mean`.

    `lightness`: factor of the first channel of `lab`, which `mean` already has.
    """
    height, width = inside.shape
    result = np.zeros((height, width), np.uint8)
    for row in range(height):
        for column in range(width):
            light = np.float32(lab[row, column, 0]) * lightness - mean[row, column, 0]
            red = np.float32(lab[row, column, 1]) - mean[row, column, 1]
            yellow = np.float32(lab[row, column, 2]) - mean[row, column, 2]
            contrast = light * light + red * red + yellow * yellow
            limit = least[row, column]
            result[row, column] = inside[row, column] * (contrast > limit * limit)
    return result


@compiled
def _largest(values: Singles, labels: Labels, count: int) -> Singles:
    """Return the largest of `values` (H, W) of each of the `labels` (H, W) below `count`."""
    largest = np.zeros(count, np.float32)
    for row in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            label = labels[row, column]
            largest[label] = max(largest[label], values[row, column])
    return largest
