"""Connected pieces of a depth image, cut at steps, against a search pixel by pixel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.configs import RegionConfig
from pipelines.tabletop.depth_segments import (
    GAP,
    _too_large,
    connected,
    extent,
    inward_fold,
    segment,
)
from pipelines.tabletop.organized import smooth_normals
from tests.geometry.tabletops import CAMERA, Box, looking_at_table, render

CONFIG = RegionConfig()
SHAPE = (14, 17)


def cloud(z):
    return np.dstack([np.zeros_like(z), np.zeros_like(z), z])


def neighbors(z, mask, pixel):
    """Yield the pixels connected to a pixel: the next along a row or column that has depth."""
    for direction in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        for span in range(1, GAP + 1):
            other = tuple(np.add(pixel, np.multiply(direction, span)))
            if not all(0 <= place < size for place, size in zip(other, z.shape, strict=True)):
                break
            first = min(pixel, other)  # its depth sets the size of a step
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
            found = [each for each in neighbors(z, mask, pixel) if each in left]
            left.difference_update(found)
            todo += found
        pieces.add(frozenset(piece))
    return pieces


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31 - 1), st.floats(0.0, 0.7), st.floats(0.3, 1.0))
def test_pieces_equal_those_of_a_flood_fill(seed, holes, share):
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


def test_pieces_are_numbered_in_the_order_of_their_first_pixels():
    rng = np.random.default_rng(0)
    z = np.where(rng.random(SHAPE) < 0.5, 0.5, 0.8)
    labels = connected(cloud(z), np.ones(SHAPE, bool), CONFIG)
    _, first = np.unique(labels, return_index=True)
    assert labels.min() == 1
    assert (np.diff(first) > 0).all()


def test_a_surface_is_followed_across_missing_pixels_but_not_across_others():
    z = np.full((1, 9), 0.5)
    mask = np.array([[1, 1, 0, 0, 0, 1, 0, 0, 1]], bool)
    open_gap = np.where(mask, z, np.nan)
    assert connected(cloud(open_gap), mask, CONFIG).max() == 1
    measured = z.copy()
    measured[0, 3] = 0.8  # another surface is between
    measured[0, [2, 4, 6, 7]] = np.nan
    assert connected(cloud(measured), mask, CONFIG).max() == 2


def test_an_image_without_depth_gives_no_pieces():
    z = np.full(SHAPE, np.nan)
    assert not connected(cloud(z), np.zeros(SHAPE, bool), CONFIG).any()


def folds_pair_by_pair(xyz, mask):
    """Return `inward_fold` of the radius 2 that `CAMERA` gives, a pixel at a time."""
    normals = smooth_normals(xyz, mask, 2)
    folds = np.zeros(mask.shape)
    for row, column in np.argwhere(mask):
        for down, right in ((0, 3), (3, 0), (3, 3), (3, -3)):
            here, there = (row - down, column - right), (row + down, column + right)
            if not all(0 <= r < mask.shape[0] and 0 <= c < mask.shape[1] for r, c in (here, there)):
                continue
            line = xyz[there] - xyz[here]
            longest = CONFIG.crease_reach / CAMERA.fx * xyz[row, column, 2] * np.hypot(down, right)
            fold = (normals[there] - normals[here]) @ line / np.linalg.norm(line)
            if np.linalg.norm(line) < longest and fold < folds[row, column]:
                folds[row, column] = fold
    return folds


def test_inward_folds_equal_those_of_single_pairs_of_normals():
    depth, index = render([Box((0.18, 0.14, 0.05)), Box((0.06, 0.06, 0.1), (0, 0, 0.05), 0.4)])
    rng = np.random.default_rng(0)
    xyz = CAMERA.backproject(np.where(rng.random(depth.shape) < 0.02, 0.0, depth))
    mask = (index >= 0) & (rng.random(depth.shape) < 0.98)
    window = tuple(slice(each.min(), each.max() + 1) for each in np.nonzero(mask))
    xyz, mask = xyz[window], mask[window]
    found = inward_fold(xyz, mask, CAMERA.fx, CONFIG)
    known = mask & np.isfinite(xyz[..., 2])
    np.testing.assert_allclose(found[known], folds_pair_by_pair(xyz, known)[known], atol=1e-5)
    assert not found[~mask].any()
    assert found.min() < -CONFIG.crease_fold  # the upper box stands on the lower one


def test_pieces_longer_than_an_object_are_too_large():
    depth, _ = render([], looking_at_table())
    xyz = CAMERA.backproject(depth)
    labels = np.zeros(depth.shape, np.int32)
    labels[60:200, 40:280] = 7  # labels have gaps
    labels[:40, 100:130] = 2
    labels[220:, 100:220] = 4
    labels[~(depth > 0)] = 0
    expected = [
        label
        for label in (2, 4, 7)
        if np.count_nonzero(labels == label) >= CONFIG.min_pixels
        and extent(xyz[labels == label]) > CONFIG.max_extent
    ]
    assert list(np.flatnonzero(_too_large(xyz, labels, CONFIG))) == expected
    assert 7 in expected


@pytest.mark.parametrize(("half", "pieces"), [(40, 1), (90, 2)])
def test_a_weak_crease_cuts_only_a_piece_that_is_too_large_for_an_object(half, pieces):
    # Two planes at 25 degrees, a fold of 2 sin 12.5 = 0.43, meet at 80 cm: together 25 or 52 cm.
    aside = np.abs(np.arange(320) - 159.5) / CAMERA.fx
    depth = 0.8 / (1.0 + np.tan(np.radians(12.5)) * aside) + np.zeros((240, 1))
    mask = np.zeros(depth.shape, bool)
    mask[100:140, 160 - half : 160 + half] = True
    labels, _ = segment(CAMERA.backproject(depth), mask, mask, CAMERA.fx, CONFIG)
    assert len(np.unique(labels[mask])) == pieces
    assert (labels[120, 160 - half] != labels[120, 159 + half]) == (pieces == 2)


def test_pixels_that_are_not_clear_belong_to_a_piece_and_connect_none():
    xyz = CAMERA.backproject(np.full((CAMERA.height, CAMERA.width), 0.5))
    foreground, clear = np.zeros((2, *xyz.shape[:2]), bool)
    foreground[100:130, 100:160] = clear[100:130, 100:160] = True
    whole, _ = segment(xyz, foreground, clear, CAMERA.fx, CONFIG)
    assert whole.max() == 1
    clear[:, 128:132] = False
    cut, by_steps = segment(xyz, foreground, clear, CAMERA.fx, CONFIG)
    assert by_steps.max() == 1
    assert len(np.unique(cut[:, 100:128][foreground[:, 100:128]])) == 1
    assert cut[115, 110] != cut[115, 150]
    np.testing.assert_array_equal(cut > 0, foreground)


def test_a_crease_between_gaps_belongs_to_its_piece_and_to_no_other_object():
    xyz = CAMERA.backproject(np.full((CAMERA.height, CAMERA.width), 0.9))
    foreground = np.zeros(xyz.shape[:2], bool)
    foreground[20:220, 20:210] = foreground[100:140, 230:300] = True
    clear = foreground.copy()
    clear[:, 200:210] = clear[:, 260:264] = False  # a strip of the large piece, and a crease
    foreground[:, 197:200] = clear[:, 197:200] = False
    xyz[:, 197:200] = np.nan
    labels, by_steps = segment(xyz, foreground, clear, CAMERA.fx, CONFIG)
    assert by_steps.max() == 2
    np.testing.assert_array_equal(labels > 0, foreground)
    assert set(labels[20:220, 200:210].ravel()) == set(labels[20:220, 20:197].ravel())
