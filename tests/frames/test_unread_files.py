"""The error about a folder without frames names its files and the missing ones."""

from pathlib import Path

import pytest

from pipelines.errors import SymgraspError
from pipelines.frames.frames import find_frames


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ([], "it is empty"),
        (["a.jpg", "b.jpg", "c/d.PNG"], "its files are 2 .jpg, 1 .png; no name has the word depth"),
        (["mesh.obj"], "its files are 1 .obj; no images are among them"),
        (["take.r3d"], "export colour and depth images from Record3D"),
        (["take.svo2"], "ZED recording"),
        (["cloud.zdf"], "save the organised cloud as .pcd"),
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
