"""ARKitScenes: images of two resolutions, each with its own camera file."""

from pathlib import Path

import pytest

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import parse_camera
from pipelines.frames.frames import find_frames
from pipelines.geometry.camera import Intrinsics
from tests.frames.layouts import build

CAMERA = "lowres_wide_intrinsics/41069021_305.371.pincam"


def test_the_camera_of_an_image_may_be_named_a_millisecond_off(tmp_path: Path) -> None:
    build.arkit_scenes(tmp_path)
    (tmp_path / CAMERA).rename(tmp_path / CAMERA.replace("371", "370"))
    for source in find_frames(tmp_path):
        assert source.read().intrinsics == Intrinsics(*build.FOUR, build.WIDTH, build.HEIGHT)


def test_images_without_a_camera_are_refused(tmp_path: Path) -> None:
    build.arkit_scenes(tmp_path)
    (tmp_path / CAMERA).unlink()
    first, second = find_frames(tmp_path)
    with pytest.raises(FormatError, match="no intrinsics are known"):
        first.read()
    second.read()


def test_measured_depth_of_high_resolution_is_read_first(tmp_path: Path) -> None:
    build.arkit_scenes(tmp_path)
    build.arkit_scenes(tmp_path, "wide")
    build.image(tmp_path / "wide/41069021_400.000.png", build.color(0))  # most have no such depth
    sources = find_frames(tmp_path)
    assert len(sources) == build.COUNT
    assert all(path.parent.name.startswith(("wide", "highres")) for path in sources[0].files)


@pytest.mark.parametrize("line", ["48 36 60 61 23.5", "48 36 60 61 23.5 x", "", "w 36 60 61 23 17"])
def test_a_line_of_other_content_is_refused(tmp_path: Path, line: str) -> None:
    build.arkit_scenes(tmp_path)
    (tmp_path / CAMERA).write_text(line)
    with pytest.raises(FormatError, match="width height fx fy cx cy"):
        find_frames(tmp_path)[0].read()


def test_a_camera_file_of_arkit_scenes_is_taken_as_option(tmp_path: Path) -> None:
    build.arkit_scenes(tmp_path)
    camera = parse_camera(str(tmp_path / CAMERA))
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == build.FOUR
    assert (camera.width, camera.height) == (build.WIDTH, build.HEIGHT)
