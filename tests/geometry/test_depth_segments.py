"""Pieces of a depth image without a step between them, against a search pixel by pixel."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import RegionConfig
from pipelines.geometry.depth_segments import GAP, connected

CONFIG = RegionConfig()
SHAPE = (14, 17)


def cloud(z):
    return np.dstack([np.zeros_like(z), np.zeros_like(z), z])


def neighbours(z, mask, pixel):
    """Yield what hangs together with a pixel: the next along a row or column that has depth."""
    for direction in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        for span in range(1, GAP + 1):
            other = tuple(np.add(pixel, np.multiply(direction, span)))
            if not all(0 <= place < size for place, size in zip(other, z.shape, strict=True)):
                break
            first = min(pixel, other)  # whose depth says what a step is
            step = CONFIG.depth_step * max(z[first], 0.5) * (1 + 0.25 * span)
            if mask[other] and abs(z[pixel] - z[other]) < step:
                yield other
            if z[other] > 0:
                break


def flooded(z, mask):
    """Return the pieces as sets of pixels."""
    left, pieces = set(map(tuple, np.argwhere(mask).tolist())), set()
    while left:
        piece, todo = set(), [left.pop()]
        while todo:
            pixel = todo.pop()
            piece.add(pixel)
            found = [each for each in neighbours(z, mask, pixel) if each in left]
            left.difference_update(found)
            todo += found
        pieces.add(frozenset(piece))
    return pieces


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31 - 1), st.floats(0.0, 0.7), st.floats(0.3, 1.0))
def test_pieces_are_what_a_flood_from_pixel_to_pixel_reaches(seed, holes, share):
    rng = np.random.default_rng(seed)
    z = 0.4 + 0.3 * rng.random() + 0.004 * rng.standard_normal(SHAPE).cumsum(axis=1)
    z[rng.random(SHAPE) < holes] = 0.0
    mask = (z > 0) & (rng.random(SHAPE) < share)
    labels = connected(cloud(np.where(z > 0, z, np.nan)), mask, CONFIG)
    np.testing.assert_array_equal(labels > 0, mask)
    found = {
        frozenset(map(tuple, np.argwhere(labels == label).tolist()))
        for label in np.unique(labels[labels > 0])
    }
    assert found == flooded(z, mask)


def test_a_surface_is_followed_across_missing_pixels_but_not_across_others():
    z = np.full((1, 9), 0.5)
    mask = np.array([[1, 1, 0, 0, 0, 1, 0, 0, 1]], bool)
    open_gap = np.where(mask, z, np.nan)
    assert connected(cloud(open_gap), mask, CONFIG).max() == 1
    measured = z.copy()
    measured[0, 3] = 0.8  # something else lies between
    measured[0, [2, 4, 6, 7]] = np.nan
    assert connected(cloud(measured), mask, CONFIG).max() == 2


def test_nothing_gives_no_pieces():
    z = np.full(SHAPE, np.nan)
    assert not connected(cloud(z), np.zeros(SHAPE, bool), CONFIG).any()
