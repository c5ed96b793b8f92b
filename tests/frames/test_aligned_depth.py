"""Depth aligned to the colour is read where raw depth of another camera is next to it."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.frames.frames import find_frames

Save = Callable[..., None]
ALIGNED = (
    ("color_0.png", "depth_0.png", "aligned_depth_0.png"),
    ("0_color.png", "0_depth.png", "0_aligned_depth_to_color.png"),
    ("0_color.png", "0_depth.png", "0_depth_aligned.png"),
    ("color.png", "depth.png", "aligned_depth.png"),
    ("rgb.png", "depth.png", "depth_registered.png"),
    ("a-rgb-0.png", "a-depth-0.png", "a-depth_to_rgb-0.png"),
    ("0_color.png", "0_depth.png", "0_transformed_depth.npy"),
    ("color/0.png", "depth/0.png", "aligned_depth_to_color/0.png"),
    ("rgb/0.png", "depth/0.png", "Depth_Aligned/0.png"),
)


def is_read(folder: Path, name: str) -> bool:
    (source,) = find_frames(folder)
    return source.files[1] == folder / name and source.read().depth.any()


@pytest.mark.parametrize(("image", "raw", "aligned"), ALIGNED)
def test_aligned_depth_is_preferred_to_raw_depth(
    tmp_path: Path, save: Save, image: str, raw: str, aligned: str
) -> None:
    save(tmp_path / image, tmp_path / aligned, tmp_path / "camera.json")
    assert is_read(tmp_path, aligned)
    (tmp_path / raw).parent.mkdir(exist_ok=True)
    cv2.imwrite(str(tmp_path / raw), np.full((48, 64), 500, np.uint16))
    assert is_read(tmp_path, aligned)


@pytest.mark.parametrize("name", ["0_unaligned_depth", "0_depthtocolorless"])
def test_words_that_only_begin_or_end_like_aligned_depth_are_others(
    flat: Path, save: Save, name: str
) -> None:
    save(flat / "0_color.png", flat / "0_depth.png", None)
    save(flat / "c_color.png", flat / f"{name}.png", None)
    found = {source.name: source.files for source in find_frames(flat)}
    assert found["0"][1] == flat / "0_depth.png"
