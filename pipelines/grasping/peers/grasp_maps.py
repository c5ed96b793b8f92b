"""Grasps as maps over an image, GG-CNN's representation: painted from rectangles, and read.

The maps contain the quality of a grasp centred at each pixel, cosine and sine of twice the angle of
its opening line, and its opening.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from pipelines.array_types import Array, Indices, Mask, Singles
from pipelines.grasping.peers.rectangles import (
    RectColumn,
    angles,
    corners,
    opening_pixels,
    rectangle_rows,
)

MAP_SIDE = 300  # pixels, shorter side of the image of the maps
WIDEST = 150.0  # pixels, unit of the map `width`
MIDDLE = 1.0 / 3.0  # painted part of a rectangle along its opening
# Least quality of a read grasp; 0.2 in the original, where labels cover more of an image.
MIN_QUALITY = 0.1
PEAK_DISTANCE = 20  # pixels, along rows or columns, between grasps that are read
MOST_PEAKS = 50
QUALITY_BLUR, ANGLE_BLUR, WIDTH_BLUR = 2.0, 2.0, 1.0  # pixels, standard deviations
# For equal qualities, as in a painted rectangle, the better surroundings decide.
TIE_BLUR, TIE_WEIGHT = 6.0, 0.01  # pixels; share of the quality


@dataclass(frozen=True)
class GraspMaps:
    """The maps (h, w): quality, cosine and sine of twice the angle, width."""

    quality: Singles
    cos: Singles
    sin: Singles
    width: Singles

    @classmethod
    def painted(cls, rows: Array, shape: tuple[int, int]) -> "GraspMaps":
        """Return the maps of rectangles `rows` (n, 7), pixels of the maps, the best on top."""
        order = np.argsort(rows[:, RectColumn.SCORE], kind="stable")
        rows = rows[order]
        index = np.zeros(shape, np.int32)
        for number, shown in enumerate(np.rint(corners(rows, MIDDLE)).astype(np.int32), start=1):
            cv2.fillConvexPoly(index, shown, number)
        double = 2.0 * np.concatenate([[0.0], angles(rows)])
        width = np.concatenate([[0.0], np.minimum(opening_pixels(rows) / WIDEST, 1.0)])
        tables = (np.cos(double), np.sin(double), width)
        cos, sin, opened = (table.astype(np.float32)[index] for table in tables)
        return cls((index > 0).astype(np.float32), cos, sin, opened)

    def rectangles(self) -> Array:
        """Return the grasps of the maps as rows (n, 7), pixels of the maps, best first.

        A network trained on squared errors mixes the labels of a pixel with the values of no grasp
        (cosine 1, sine 0, width 0); the share of the labels is the quality. The mixture is undone.
        """
        quality = _blurred(self.quality, QUALITY_BLUR)
        cos, sin = _blurred(self.cos, ANGLE_BLUR), _blurred(self.sin, ANGLE_BLUR)
        cos = cos - (1.0 - quality)
        width = self.width_of_grasps()
        y, x = peaks(quality)
        q, c, s, w = (each[y, x].astype(np.float64) for each in (quality, cos, sin, width))
        opening = WIDEST * np.clip(w, 0.0, 1.0)
        center = np.stack([x, y], axis=1).astype(np.float64)
        return rectangle_rows(center, 0.5 * np.arctan2(s, c), opening, 0.5 * opening, q)

    def width_of_grasps(self) -> Singles:
        """Return the width (h, w) of a grasp at each pixel, assuming that there is a grasp."""
        share = np.maximum(_blurred(self.quality, WIDTH_BLUR), MIN_QUALITY)
        return np.asarray(_blurred(self.width, WIDTH_BLUR) / share, np.float32)


def peaks(quality: Singles) -> tuple[Indices, Indices]:
    """Return rows and columns of the maxima of `quality` (h, w), highest first."""
    window = np.ones((2 * PEAK_DISTANCE + 1,) * 2, np.uint8)
    height = quality + TIE_WEIGHT * _blurred(quality, TIE_BLUR)
    highest: Mask = height >= cv2.dilate(height, window)
    y, x = np.nonzero(highest & (quality >= MIN_QUALITY))
    order = np.argsort(-height[y, x], kind="stable")
    taken, chosen = np.zeros(quality.shape, bool), []
    for i in order.tolist():
        if taken[y[i], x[i]]:
            continue
        chosen.append(i)
        low = np.maximum([y[i] - PEAK_DISTANCE, x[i] - PEAK_DISTANCE], 0)
        taken[low[0] : y[i] + PEAK_DISTANCE + 1, low[1] : x[i] + PEAK_DISTANCE + 1] = True
        if len(chosen) == MOST_PEAKS:
            break
    return y[chosen], x[chosen]


def scaled_rows(rows: Array, scale: float) -> Array:
    """Return rectangles `rows` (n, 7) in an image `scale` times as large."""
    moved = rows.copy()
    for columns in (RectColumn.CENTER, RectColumn.SIDE):
        moved[:, columns] = (rows[:, columns] + 0.5) * scale - 0.5
    moved[:, RectColumn.HEIGHT] = rows[:, RectColumn.HEIGHT] * scale
    return moved


def _blurred(image: Singles, sigma: float) -> Singles:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma), np.float32)
