"""Colour that is marked by EXIF as to be shown turned."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.storage.images import write_image

ORIENTATION = 0x0112  # EXIF's tag
STATED = FrameOptions(CameraFile(60.0, 60.0, 28.0, 28.0))
STORED = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)


def marked_frame(folder: Path, orientation: int, shape: tuple[int, int]) -> None:
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    Image.fromarray(STORED).save(folder / "color.png", exif=exif)
    write_image(folder / "depth.png", np.full(shape, 500, np.uint16))


@pytest.mark.parametrize(("orientation", "turns"), [(6, -1), (8, 1)])
def test_colour_is_turned_as_marked_where_only_then_it_has_the_sides_of_the_depth(
    tmp_path: Path, orientation: int, turns: int
) -> None:
    marked_frame(tmp_path, orientation, (64, 48))
    frame = find_frames(tmp_path, STATED)[0].read()
    assert (frame.color == np.rot90(STORED, turns)).all()
    assert any("turned by its EXIF orientation" in note for note in frame.notes)


@pytest.mark.parametrize("orientation", [2, 3, 6, 8])
def test_another_mark_is_not_applied_but_named(tmp_path: Path, orientation: int) -> None:
    marked_frame(tmp_path, orientation, (48, 64))
    frame = find_frames(tmp_path, STATED)[0].read()
    assert (frame.color == STORED).all()
    assert any(f"EXIF orientation {orientation} of the colour is" in n for n in frame.notes)


def test_upright_colour_and_damaged_marks_get_no_remark(tmp_path: Path) -> None:
    marked_frame(tmp_path, 1, (48, 64))
    assert find_frames(tmp_path, STATED)[0].read().notes == ()
    marked_frame(tmp_path, 99, (48, 64))
    assert find_frames(tmp_path, STATED)[0].read().notes == ()
