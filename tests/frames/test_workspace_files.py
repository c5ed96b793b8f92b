"""Values of `--workspace` and `--approach-direction`."""

import numpy as np
import pytest

from pipelines.errors import FormatError, SymgraspError, ValueRangeError
from pipelines.frames.workspace_files import (
    parse_workspace,
    read_workspace_mask,
)
from pipelines.storage.images import write_image


def test_six_numbers_give_a_box_a_file_gives_a_mask_and_no_value_gives_no_limit(tmp_path):
    assert parse_workspace("-0.1,0,0.4, .1 0.2,1e0") == ((-0.1, 0, 0.4, 0.1, 0.2, 1), None)
    write_image(tmp_path / "m.png", np.zeros((4, 5), np.uint8))
    assert parse_workspace(str(tmp_path / "m.png")) == ((), tmp_path / "m.png")
    assert parse_workspace(None) == ((), None)


@pytest.mark.parametrize("text", ["", "no.png", "1,2,3", "1,2,3,4,5,6,7", 300 * "1"])
def test_anything_else_is_refused_with_both_forms(text):
    with pytest.raises(ValueRangeError, match=r"x0,y0,z0,x1,y1,z1.*path of an existing mask"):
        parse_workspace(text)


def test_a_file_that_is_no_image_is_refused_before_any_frame_is_read(tmp_path):
    (tmp_path / "box.txt").write_text("1 2 3 4 5 6")
    with pytest.raises(FormatError, match=r"box.txt: .*image"):
        parse_workspace(str(tmp_path / "box.txt"))


@pytest.mark.parametrize("channels", [None, 3])
def test_pixels_that_are_not_black_are_inside(tmp_path, channels):
    mask = np.zeros((4, 5), np.uint8)
    mask[1:3, 2:4] = 1
    stored = mask if channels is None else np.stack([0 * mask, mask, 0 * mask], -1)
    write_image(tmp_path / "m.png", stored)
    np.testing.assert_array_equal(read_workspace_mask(tmp_path / "m.png", (4, 5)), mask > 0)


def test_a_mask_of_another_size_and_a_file_that_is_no_picture_are_refused(tmp_path):
    write_image(tmp_path / "m.png", np.zeros((4, 5), np.uint8))
    with pytest.raises(SymgraspError, match="5 x 4"):
        read_workspace_mask(tmp_path / "m.png", (5, 4))
    (tmp_path / "bad.png").write_bytes(b"no")
    with pytest.raises(SymgraspError, match="bad"):
        read_workspace_mask(tmp_path / "bad.png", (5, 4))
