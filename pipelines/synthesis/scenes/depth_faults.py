"""Faults of real depth that analytic sensors lack; figures in docs/experiments/data-sets.md.

Real sensors lose patches of dark, shiny and absorbing surfaces, blend both sides of an edge into
pixels that float between them, fill small holes, and have wavy errors over some centimetres.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Indices, Mask

DARK, GLARE = 45, 235  # grey levels of the brightest and of the darkest channel
EDGE = 0.02  # metres between neighbouring pixels
GRAIN = (1.5, 14.0)  # pixels of a picture 640 wide, the size of patches without depth
WIDTH = 640  # pixels, reference width of the images for lengths


def with_faults(
    depth: Array, color: NDArray[np.uint8], surface: Indices, rng: np.random.Generator
) -> Array:
    """Return `depth` (H, W) metres, 0 = missing, with faults of random strength.

    `color`: (H, W, 3). `surface`: (H, W) number of the visible object, table, wall, ...
    """
    scale = depth.shape[1] / WIDTH
    depth = depth + _waves(depth, rng)
    if rng.uniform() < 0.4:
        depth = _filled(depth, max(1, round(scale * rng.integers(1, 4))))
    if rng.uniform() < 0.6:
        depth = _blended(depth, max(0.4, scale * rng.uniform(0.6, 2.0)))
    lost = _patches(depth.shape, rng.uniform(0.0, 0.6) ** 2, rng) & (color.max(axis=2) < DARK)
    lost |= _patches(depth.shape, rng.uniform(0.0, 0.6), rng) & (color.min(axis=2) > GLARE)
    for which in np.unique(surface):
        if rng.uniform() < 0.12:  # glass, black plastic, polished metal
            share = rng.uniform(0.2, 1.0)
            lost |= _patches(depth.shape, share, rng) & (surface == which)
    return np.where(lost | (depth <= 0.0), 0.0, depth)


def _waves(depth: Array, rng: np.random.Generator) -> Array:
    """Return a smooth error (H, W) that grows with the square of the distance, metres."""
    strength = 0.002 * rng.uniform() ** 2
    error = strength * _smooth_noise(depth.shape, rng.uniform(4.0, 25.0), rng) * depth**2
    return np.where(depth > 0.0, error, 0.0)


def _filled(depth: Array, pixels: int) -> Array:
    """Return `depth` with holes of up to twice `pixels` filled by the farthest depth around."""
    kernel = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    closed = np.asarray(cv2.morphologyEx(depth, cv2.MORPH_CLOSE, kernel), np.float64)
    return np.where(depth > 0.0, depth, closed)


def _blended(depth: Array, sigma: float) -> Array:
    """Return `depth` with the two sides of every edge blended into each other."""
    seen = np.asarray(depth > 0.0, np.float64)
    weight = np.asarray(cv2.GaussianBlur(seen, (0, 0), sigma), np.float64)
    mean = np.asarray(cv2.GaussianBlur(depth, (0, 0), sigma), np.float64) / np.maximum(weight, 1e-6)
    return np.where((depth > 0.0) & (np.abs(mean - depth) > EDGE / 4.0), mean, depth)


def _patches(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> Mask:
    """Return a mask (H, W) of patches that cover about `share` of the picture."""
    noise = _smooth_noise(shape, max(1.0, shape[1] / WIDTH * rng.uniform(*GRAIN)), rng)
    return np.asarray(noise < np.quantile(noise[::4, ::4], share))


def _smooth_noise(shape: tuple[int, ...], sigma: float, rng: np.random.Generator) -> Array:
    """Return smooth noise (H, W) of mean 0 and standard deviation 1."""
    noise = np.asarray(cv2.GaussianBlur(rng.normal(size=shape), (0, 0), sigma), np.float64)
    return np.asarray((noise - noise.mean()) / noise.std())
