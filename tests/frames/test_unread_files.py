"""The error about a folder without frames names its files and the missing ones."""

import time
from pathlib import Path

import pytest

from pipelines.errors import SymgraspError
from pipelines.frames.frames import find_frames
from pipelines.frames.unread_files import why_no_frames


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ([], "it is empty"),
        (["a.jpg", "b.jpg", "c/d.PNG"], "its files are 2 .jpg, 1 .png; no name has the word depth"),
        (["mesh.obj"], "its files are 1 .obj; no images are among them"),
        (["take.r3d"], "export colour and depth images from Record3D"),
        (["take.svo2"], "ZED recording"),
        (["frames.tar.gz"], "unpack the archive"),
        (["frames.h5"], "or as .npz with depth, K and rgb"),
        (["left.png", "my_depth_map.pfm"], "my_depth_map.pfm and left.png are no pair"),
        (["my_depth_map.pfm"], "no colour image goes with my_depth_map.pfm"),
    ],
)
def test_the_files_of_the_folder_and_the_missing_ones_are_named(
    tmp_path: Path, files: list[str], sentence: str
) -> None:
    for file in files:
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(b"")
    with pytest.raises(SymgraspError, match="holds no RGB-D frames") as caught:
        find_frames(tmp_path)
    assert sentence in str(caught.value)
    assert "put x_color.png next to x_depth.png" in str(caught.value)


def test_a_folder_of_many_images_is_described_at_once(tmp_path: Path) -> None:
    for number in range(2000):
        (tmp_path / f"{number}_depth_map.png").touch()
    started = time.monotonic()
    assert "no colour image goes with" in why_no_frames(tmp_path)
    assert time.monotonic() - started < 1.0
