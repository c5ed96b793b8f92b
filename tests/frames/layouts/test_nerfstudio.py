"""transforms.json: cameras of single frames, other lenses, names."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from pipelines.errors import FormatError
from pipelines.frames.frames import find_frames
from pipelines.geometry.camera import Intrinsics
from tests.frames.layouts import build


@pytest.fixture
def edit(tmp_path: Path) -> Callable[[Callable[[dict[str, Any]], None]], Path]:
    """Change transforms.json of two frames; return their folder."""

    def change(how: Callable[[dict[str, Any]], None]) -> Path:
        build.nerfstudio(tmp_path)
        content = json.loads((tmp_path / "transforms.json").read_text())
        how(content)
        (tmp_path / "transforms.json").write_text(json.dumps(content))
        return tmp_path

    return change


def test_a_frames_own_camera_wins(edit) -> None:
    folder = edit(lambda content: content["frames"][1].update(fl_x=70.0))
    assert [s.read().intrinsics.fx for s in find_frames(folder)] == [60.0, 70.0]


def test_depth_smaller_than_the_colour_has_the_resized_camera(edit) -> None:
    folder = edit(lambda _content: None)
    expected = Intrinsics(*build.FOUR, build.WIDTH, build.HEIGHT).resized(24, 18)
    build.image(folder / "depths/1.png", build.depth(1)[::2, ::2])
    assert find_frames(folder)[1].read().intrinsics == expected
    build.image(folder / "depths/1.png", build.depth(1)[::3, ::2])
    with pytest.raises(FormatError, match="describes 48x36 images, but the depth is 24x12"):
        find_frames(folder)[1].read()


def test_depth_of_polycam_is_smaller_than_its_camera(tmp_path: Path) -> None:
    build.pair(tmp_path / "images/7.jpg", tmp_path / "depth/7.png", 0)
    build.image(tmp_path / "depth/7.png", build.depth(0)[::2, ::2])
    numbers = dict(zip(("fx", "fy", "cx", "cy"), build.FOUR, strict=True))
    size = {"width": build.WIDTH, "height": build.HEIGHT}
    (tmp_path / "cameras").mkdir()
    build.write(tmp_path / "cameras/7.json", numbers | size | {"t_00": 1.0})
    assert find_frames(tmp_path)[0].read().intrinsics.fx == build.FOUR[0] / 2
    build.write(tmp_path / "cameras/7.json", numbers | size)
    with pytest.raises(FormatError, match=r"--intrinsics 30,30\.5,11\.5,8\.5 if it is registered"):
        find_frames(tmp_path)[0].read()


def test_panoramas_are_refused(edit) -> None:
    folder = edit(lambda content: content.update(camera_model="EQUIRECTANGULAR"))
    with pytest.raises(FormatError, match=r"EQUIRECTANGULAR.*undistort"):
        find_frames(folder)[0].read()


@pytest.mark.parametrize("model", ["OPENCV", "OPENCV_FISHEYE"])
def test_distortion_is_removed(edit, model: str) -> None:
    folder = edit(lambda content: content.update(k1=0.1, camera_model=model))
    assert "distortion" in find_frames(folder)[0].read().notes[0]


def test_frames_without_depth_are_left_out(edit) -> None:
    folder = edit(lambda content: content["frames"][0].pop("depth_file_path"))
    assert [source.name for source in find_frames(folder)] == ["1"]


def test_images_of_the_same_name_are_distinguished_by_their_folder(edit) -> None:
    def elsewhere(content: dict[str, Any]) -> None:
        content["frames"][0]["file_path"] = "../../left/1.png"

    names = [source.name for source in find_frames(edit(elsewhere))]
    assert names == ["left/1", "images/1"]


def test_if_two_names_repeat_all_names_have_their_folder(edit) -> None:
    def third(content: dict[str, Any]) -> None:
        content["frames"].append(content["frames"][0] | {"file_path": "left/1.png"})

    names = [source.name for source in find_frames(edit(third))]
    assert names == ["images/0", "images/1", "left/1"]


def test_frames_of_one_damaged_name_are_two_frames(edit) -> None:
    def nameless(content: dict[str, Any]) -> None:
        for frame in content["frames"]:
            frame["file_path"] = "/"

    folder = edit(nameless)
    assert [s.name for s in find_frames(folder)] == [folder.name, f"{folder.name}-2"]


def test_frames_of_instant_ngp_are_read(edit) -> None:
    def renamed(content: dict[str, Any]) -> None:
        content["integer_depth_scale"] = 1 / 2000
        for frame in content["frames"]:
            frame["depth_path"] = frame.pop("depth_file_path")
            frame["file_path"] = frame["file_path"].removesuffix(".png")

    frames = [source.read() for source in find_frames(edit(renamed))]
    assert [frame.name for frame in frames] == ["0", "1"]
    assert_allclose(frames[1].depth, build.depth(1) / 2000, atol=1e-6)


def test_images_without_depth_have_the_camera_of_transforms(edit) -> None:
    folder = edit(lambda content: content.update(frames=[]))
    build.pair(folder / "0_color.png", folder / "0_depth.png", 0)
    camera = find_frames(folder)[0].read().intrinsics
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == build.FOUR
