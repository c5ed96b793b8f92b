"""Pieces of a labelled image one by one, and their holes."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_fill_holes

from pipelines.tabletop.regions.pieces import pieces_of_labels
from pipelines.tabletop.regions_geometric import enlarged, without_holes, working_step


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 12), st.integers(1, 9), st.floats(0.0, 1.0))
def test_pieces_are_the_labels_with_enough_pixels(seed, most, least, share):
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, most + 1, (7, 9)).astype(np.int32)
    labels[rng.random(labels.shape) < share] = 0
    xyz = rng.normal(size=(7, 9, 3))
    wanted = [n for n in range(1, most + 1) if np.count_nonzero(labels == n) >= least]
    found = pieces_of_labels(labels, xyz, least)
    assert [piece.label for piece in found] == wanted
    for piece in found:
        mask = labels == piece.label
        np.testing.assert_array_equal(piece.pixels, np.flatnonzero(mask))
        np.testing.assert_array_equal(piece.points, xyz[mask])
        rows, columns = np.nonzero(mask)
        box = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
        assert piece.box == box


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 12), st.integers(1, 12), st.floats(0.0, 1.0))
def test_holes_are_pixels_without_a_path_to_the_outside(seed, height, width, share):
    mask = np.random.default_rng(seed).random((height, width)) < share
    np.testing.assert_array_equal(without_holes(mask), binary_fill_holes(mask))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.integers(700, 4000), st.integers(1, 9))
def test_an_enlarged_label_reaches_to_the_pixels_nearest_to_its_own(seed, width, height):
    shape = height, width
    step = working_step(shape)
    thinned = np.random.default_rng(seed).integers(0, 5, shape)[::step, ::step]
    large = enlarged(thinned, shape)
    np.testing.assert_array_equal(large[::step, ::step], thinned)
    columns = np.arange(width)
    nearest = np.abs(columns[:, None] - np.arange(thinned.shape[1]) * step).argmin(axis=1)
    np.testing.assert_array_equal(large[0], thinned[0, nearest])
