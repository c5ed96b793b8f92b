"""Instance masks: the user's files, and run lengths."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_array_equal
from PIL import Image

from pipelines.errors import FormatError, SymgraspError, ValueRangeError
from pipelines.frames.frame_names import shared_last_parts
from pipelines.frames.masks import read_masks
from pipelines.storage.masks_rle import box_of_mask, decode_mask, encode_mask

masks = hnp.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9)))


@settings(max_examples=25, deadline=None)
@given(masks)
def test_a_mask_survives_its_run_lengths(mask: np.ndarray) -> None:
    counts = encode_mask(mask)
    assert counts.sum() == mask.size
    assert_array_equal(decode_mask(counts, mask.shape[1], mask.shape[0]), mask)


def test_run_lengths_go_down_the_columns_zeros_first() -> None:
    mask = np.array([[True, False, False], [True, True, False]])
    assert encode_mask(mask).tolist() == [0, 2, 1, 1, 2]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of pycocotools
def test_run_lengths_equal_those_of_pycocotools() -> None:
    coco = pytest.importorskip("pycocotools.mask")
    mask = np.random.default_rng(0).random((20, 30)) > 0.6
    runs = coco.frPyObjects({"counts": encode_mask(mask).tolist(), "size": [20, 30]}, 20, 30)
    assert_array_equal(coco.decode(runs).astype(bool), mask)


def test_run_lengths_that_do_not_fill_the_image_are_refused() -> None:
    with pytest.raises(ValueRangeError, match="3x3"):
        decode_mask(np.array([4, 4]), 3, 3)


def test_the_box_ends_after_the_last_pixel() -> None:
    mask = np.zeros((10, 12), bool)
    mask[2:5, 3:9] = True
    assert box_of_mask(mask).tolist() == [3, 2, 9, 5]
    assert box_of_mask(np.zeros((4, 4), bool)).tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize("name", ["s/x_label.png", "s/x.png", "x_mask.png", "x.png"])
def test_a_users_mask_is_found_under_each_known_name(tmp_path: Path, name: str) -> None:
    ids = np.arange(12, dtype=np.uint16).reshape(3, 4) * 100
    (tmp_path / "s").mkdir()
    cv2.imwrite(str(tmp_path / name), ids)
    assert_array_equal(read_masks(tmp_path, "s/x", ids.shape), ids)


def test_frames_that_share_their_last_part_do_not_share_a_mask(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "x.png"), np.ones((3, 4), np.uint8))
    assert read_masks(tmp_path, "s/x", (3, 4), shared_last_parts(["s/x", "t/y"])).all()
    with pytest.raises(SymgraspError, match=r"give s/x_label\.png.* as several frames end in x"):
        read_masks(tmp_path, "s/x", (3, 4), shared_last_parts(["s/x", "t/x"]))


def test_a_missing_mask_is_refused_with_the_expected_names(tmp_path: Path) -> None:
    with pytest.raises(SymgraspError, match=r"s/x_label\.png"):
        read_masks(tmp_path, "s/x", (3, 4))


def test_each_colour_is_an_instance_and_black_is_background(tmp_path: Path) -> None:
    ids = np.array([[0, 1, 1, 0], [2, 2, 3, 0]])
    colors = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 7], [0, 0, 9]], np.uint8)
    Image.fromarray(colors[ids]).save(tmp_path / "x.png")
    assert_array_equal(
        read_masks(tmp_path, "x", ids.shape), np.array([0, 0xFF0000, 0xFF07, 9])[ids]
    )


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_photograph_is_no_mask(tmp_path: Path, kind: type) -> None:
    photograph = np.random.default_rng(0).integers(0, 255, (60, 80, 3)).astype(kind)
    cv2.imwrite(str(tmp_path / "x.png"), photograph)
    with pytest.raises(FormatError, match="as a photograph has"):
        read_masks(tmp_path, "x", (60, 80))


def test_a_mask_drawn_on_colour_of_another_size_is_read_at_the_size_of_the_depth(
    tmp_path: Path,
) -> None:
    ids = np.arange(12, dtype=np.uint8).reshape(3, 4)
    for factor in (1, 2, 3):
        cv2.imwrite(str(tmp_path / "x.png"), np.kron(ids, np.ones((factor, factor), np.uint8)))
        assert_array_equal(read_masks(tmp_path, "x", ids.shape), ids)
    with pytest.raises(
        FormatError, match=r"x\.png: has 12 x 9 pixels; the frame's depth has 4 x 4"
    ):
        read_masks(tmp_path, "x", (4, 4))


def test_three_equal_channels_are_read_as_one(tmp_path: Path) -> None:
    ids = np.arange(12, dtype=np.uint8).reshape(3, 4)
    cv2.imwrite(str(tmp_path / "x.png"), np.repeat(ids[:, :, None], 3, axis=2))
    assert_array_equal(read_masks(tmp_path, "x", ids.shape), ids)


@pytest.mark.parametrize("bits", [2, 8])
def test_a_palette_image_is_read_by_its_indices_and_not_its_colours(
    tmp_path: Path, bits: int
) -> None:
    ids = np.array([[0, 1, 1, 0], [2, 2, 3, 0]], np.uint8)
    if bits == 8:
        ids[0, 3] = 255  # outlines, as PASCAL VOC's masks have them
    picture = Image.fromarray(ids, mode="P")
    picture.putpalette(np.random.default_rng(0).permutation(768).astype(np.uint8).tobytes())
    picture.save(tmp_path / "x.png", bits=bits)
    assert_array_equal(read_masks(tmp_path, "x", ids.shape), np.where(ids == 255, 0, ids))
