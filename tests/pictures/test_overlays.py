"""Overlays hold the stamp of the run whose grasps they show, and stay normal PNG files."""

import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipelines.pictures.overlays import draw_overlay, is_drawn, write_overlay
from pipelines.storage.images import read_image
from pipelines.storage.provenance import make_stamp
from tests.pictures.grasp_page.toys import toy_frame, toy_result

FRAME, INDEX = toy_frame()
RESULT = toy_result(FRAME, INDEX)
STAMP = make_stamp("infer", {"gripper": "rg2"}, seed=3, inputs={"é": "sha256:1"})


@pytest.fixture
def picture(tmp_path):
    write_overlay(tmp_path / "a.png", FRAME, RESULT, STAMP)
    return tmp_path / "a.png"


def chunks_of(data: bytes) -> list[tuple[bytes, bytes]]:
    """Return the kinds and contents of a PNG's chunks, after verifying their check sums."""
    place, found = 8, []
    while place < len(data):
        size = int.from_bytes(data[place : place + 4], "big")
        kind, content = data[place + 4 : place + 8], data[place + 8 : place + 8 + size]
        check = int.from_bytes(data[place + 8 + size : place + 12 + size], "big")
        assert check == zlib.crc32(kind + content)
        found.append((kind, content))
        place += 12 + size
    return found


def test_the_file_holds_the_drawn_picture_with_a_text_after_its_header(picture):
    np.testing.assert_array_equal(read_image(picture), draw_overlay(FRAME, RESULT))
    chunks = chunks_of(picture.read_bytes())
    assert [kind for kind, _ in chunks[:2]] == [b"IHDR", b"tEXt"]
    assert chunks[1][1] == b"provenance\0" + STAMP.as_text().encode("latin-1")
    assert chunks[-1][0] == b"IEND"


def test_a_grasp_that_is_not_worth_trying_is_drawn_faintly():
    weak = replace(RESULT.grasps, worth_trying=np.zeros(len(RESULT.grasps), bool))
    bare = draw_overlay(FRAME, replace(RESULT, grasps=type(weak).empty()))
    marked = [
        int((draw_overlay(FRAME, replace(RESULT, grasps=table)) != bare).any(axis=-1).sum())
        for table in (weak, RESULT.grasps)
    ]
    assert 0 < marked[0] < 0.7 * marked[1]


def test_the_same_result_gives_the_same_bytes(picture):
    again = picture.with_name("b.png")
    write_overlay(again, FRAME, RESULT, STAMP)
    assert again.read_bytes() == picture.read_bytes()


def test_a_picture_is_recognised_by_its_own_stamp_only(picture):
    assert is_drawn(picture, STAMP)
    for change in ({"seed": 4}, {"config": {"gripper": "franka"}}, {"inputs": {}}):
        assert not is_drawn(picture, replace(STAMP, **change))


def test_other_and_damaged_files_are_not_taken_for_our_pictures(picture, tmp_path):
    data = picture.read_bytes()
    for size in (0, 20, 40, 60):
        picture.write_bytes(data[:size])
        assert not is_drawn(picture, STAMP)
    cv2.imwrite(str(picture), FRAME.color)
    assert not is_drawn(picture, STAMP)
    assert not is_drawn(tmp_path, STAMP)
    assert not is_drawn(tmp_path / "none.png", STAMP)
