"""The error about a folder without frames names its files and the missing ones."""

from pathlib import Path

import pytest

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import FrameSource
from tests.frames.layouts import build


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ([], "it holds no files, or hidden ones only"),
        ([".a.png"], "it holds no files, or hidden ones only"),
        (["README"], "its files are 1 without a suffix"),
        (["a.jpg", "b.jpg", "c/d.PNG"], "its files are 2 .jpg, 1 .png; no name has the word depth"),
        (["mesh.obj"], "its files are 1 .obj; no images are among them"),
        (["take.r3d"], "export colour and depth images from Record3D"),
        (["take.svo2"], "ZED recording"),
        (["cloud.zdf"], "save the organised cloud as .pcd"),
        (["frames.tar.gz"], "unpack it"),
        (["run.db3.zstd"], "unpack it"),
        (["run.bag.active"], "rosbag reindex"),
        (["frames.h5"], "or as .npz with depth, K and image (RGB)"),
        (["rgb.mp4", "depth/000000.png"], "ffmpeg -i rgb.mp4 -start_number 0 rgb/%06d.png"),
        (["left.png", "my_depth_map.dpt"], "my_depth_map.dpt and left.png are no pair"),
        (["my_depth_map.dpt"], "no colour image goes with my_depth_map.dpt"),
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


@pytest.mark.parametrize(
    ("there", "place", "named"),
    [
        ("x_depth.png", "x_color.heic", "no colour image next to it but x_color.heic"),
        ("X_Depth.png", "X_rgb.npy", "no colour image next to it but X_rgb.npy"),
        ("x_color.png", "x_depth.csv", "no depth image next to it but x_depth.csv"),
        ("depth/7.png", "color/7.gif", "no colour image next to it but 7.gif"),
    ],
)
def test_a_file_in_the_place_of_an_image_is_named(
    tmp_path: Path, there: str, place: str, named: str
) -> None:
    build.pair(tmp_path / "whole_color.png", tmp_path / "whole_depth.png", 0)
    build.image(tmp_path / there, build.depth(0))
    (tmp_path / place).parent.mkdir(exist_ok=True)
    (tmp_path / place).write_bytes(b"GIF")
    if "/" in there:
        (tmp_path / "whole_color.png").unlink()
        (tmp_path / "whole_depth.png").unlink()
    faults = [_fault(source) for source in find_frames(tmp_path)]
    assert any(named in fault for fault in faults)


def test_a_broken_link_in_the_place_of_an_image_is_named(tmp_path: Path) -> None:
    build.image(tmp_path / "x_color.png", build.color(0))
    (tmp_path / "x_depth.png").symlink_to(tmp_path / "moved.png")
    (source,) = find_frames(tmp_path)
    assert "but x_depth.png, which is no file" in _fault(source)


@pytest.mark.parametrize("depth", ["x_depth_map.png", "depth_map.png"])
def test_an_image_that_is_read_under_another_name_is_no_pair(tmp_path: Path, depth: str) -> None:
    build.pair(tmp_path / depth.replace("depth", "rgb"), tmp_path / depth, 0)
    color = depth.replace("depth", "rgb")
    expected = f"next to it but {color}, whose name does not pair with it; both have one name"
    assert any(expected in _fault(source) for source in find_frames(tmp_path))


@pytest.mark.parametrize("name", ["x_depth_raw.png", "raw_depth_x.png", "x_raw_depth.npy"])
def test_an_image_with_a_further_word_in_its_name_is_named(tmp_path: Path, name: str) -> None:
    build.pair(tmp_path / "x_color.png", tmp_path / "x_depth.png", 0)
    (tmp_path / "x_depth.png").rename(tmp_path / name)
    build.image(tmp_path / "box_depth.png", build.depth(0))
    expected = f"next to it but {name}, whose name does not pair with it; both have one name"
    assert any(expected in _fault(source) for source in find_frames(tmp_path))


def test_images_named_after_their_times_are_advised_to_be_listed(tmp_path: Path) -> None:
    build.pair(
        tmp_path / "rgb/0000001-000000033369.png", tmp_path / "depth/0000001-000000030051.png", 0
    )
    for source in find_frames(tmp_path):
        assert "depth/x.png, or by time in rgb.txt and depth.txt as of TUM" in _fault(source)


def _fault(source: FrameSource) -> str:
    try:
        source.read()
    except FormatError as error:
        return str(error)
    return ""


def test_folders_of_images_have_any_usual_letter_case(tmp_path: Path) -> None:
    build.pair(tmp_path / "RGB/0.png", tmp_path / "Depth/0.png", 0)
    (source,) = find_frames(tmp_path)
    assert source.layout == "colour and depth folders"
    assert source.name == "0"


def test_images_that_are_no_pair_are_named_with_their_folders(tmp_path: Path) -> None:
    build.pair(tmp_path / "view/0.png", tmp_path / "aligned_depth/0.png", 0)
    with pytest.raises(SymgraspError, match=r"aligned_depth/0.png and view/0.png are no pair"):
        find_frames(tmp_path)


@pytest.mark.parametrize(
    ("file", "sentence"),
    [
        ("x_depth.raw", "save raw depth as a 16-bit PNG"),
        ("take.r3d", "export colour and depth images from Record3D"),
        ("photo.png", "put x_color.png next to x_depth.png"),
        ("run.mp4", "save a video's images"),
    ],
)
def test_a_file_of_no_frame_is_refused_with_what_would_be_right(
    tmp_path: Path, file: str, sentence: str
) -> None:
    (tmp_path / file).write_bytes(b"")
    with pytest.raises(SymgraspError, match=f"{file} is part of no RGB-D frame; ") as caught:
        find_frames(tmp_path / file)
    assert sentence in str(caught.value)


def test_a_path_to_nothing_is_refused_as_such(tmp_path: Path) -> None:
    with pytest.raises(SymgraspError, match="nowhere does not exist; give the folder"):
        find_frames(tmp_path / "nowhere")


def test_a_device_exists_but_holds_no_frames() -> None:
    with pytest.raises(SymgraspError, match="/dev/null is no file or folder"):
        find_frames(Path("/dev/null"))
