"""Images of one view are read, with its camera, where colour and depth have two cameras."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.errors import FormatError
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

# The raw colour, the depth, and the colour in the depth's view.
ALIGNED_COLOR = (
    ("color_0.png", "depth_0.png", "transformed_color_0.png"),
    ("0_rgb.png", "0_depth.png", "0_rgb_to_depth.png"),
    ("color.png", "depth.png", "color_aligned_to_depth.png"),
    ("color/0.png", "depth/0.png", "transformed_color/0.png"),
)
TWO_CAMERAS = (
    ("color_intrinsics.json", "depth_intrinsics.json"),
    ("intrinsics_rgb.yaml", "intrinsics_depth.yaml"),
    ("0_color_camera.json", "0_depth_camera.json"),
    ("both.json", "both.json"),
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


@pytest.mark.parametrize(("raw", "measured", "aligned"), ALIGNED_COLOR)
def test_colour_in_the_view_of_the_depth_is_preferred_to_raw_colour(
    tmp_path: Path, save: Save, raw: str, measured: str, aligned: str
) -> None:
    save(tmp_path / aligned, tmp_path / measured, tmp_path / "camera.json")
    (tmp_path / raw).parent.mkdir(exist_ok=True)
    cv2.imwrite(str(tmp_path / raw), np.zeros((90, 160, 3), np.uint8))
    (source,) = find_frames(tmp_path)
    assert source.files[:2] == (tmp_path / aligned, tmp_path / measured)
    assert source.read().color.any()


def test_aligned_depth_is_read_with_raw_colour_where_all_four_images_are(
    tmp_path: Path, save: Save
) -> None:
    for kind in ("", "transformed_"):
        save(tmp_path / f"{kind}color_0.png", tmp_path / f"{kind}depth_0.png", None)
    (source,) = find_frames(tmp_path)
    assert [path.name for path in source.files] == ["color_0.png", "transformed_depth_0.png"]


def write_cameras(folder: Path, color: str, depth: str) -> None:
    lens = {"cx": 31.5, "cy": 23.5}
    cameras = {"color": lens | {"fx": 60.0, "fy": 60.0}, "depth": lens | {"fx": 50.0, "fy": 50.0}}
    if color == depth:
        (folder / color).write_text(json.dumps(cameras))
        return
    (folder / color).write_text(json.dumps(cameras["color"]))
    (folder / depth).write_text(json.dumps(cameras["depth"]))


@pytest.mark.parametrize("cameras", TWO_CAMERAS)
@pytest.mark.parametrize(
    ("image", "measured", "focal_length"),
    [
        ("0_color.png", "0_aligned_depth.png", 60.0),
        ("color/0.png", "aligned_depth_to_color/0.png", 60.0),
        ("0_transformed_color.png", "0_depth.png", 50.0),
        ("0_color.png", "0_depth.png", None),
        ("0_aligned_color.png", "0_aligned_depth.png", None),
    ],
)
def test_of_two_cameras_the_one_whose_view_the_images_have_is_taken(
    tmp_path: Path,
    save: Save,
    cameras: tuple[str, str],
    image: str,
    measured: str,
    focal_length: float | None,
) -> None:
    save(tmp_path / image, tmp_path / measured, None)
    write_cameras(tmp_path, *cameras)
    (source,) = find_frames(tmp_path)
    if focal_length is not None:
        assert source.read().intrinsics.fx == focal_length
        return
    with pytest.raises(FormatError, match="--intrinsics"):
        source.read()


def test_the_unit_in_the_camera_of_the_depth_counts_for_aligned_depth(
    tmp_path: Path, save: Save
) -> None:
    save(tmp_path / "0_color.png", tmp_path / "0_aligned_depth.png", None)
    write_cameras(tmp_path, "cameras.json", "cameras.json")
    cameras = json.loads((tmp_path / "cameras.json").read_text())
    cameras["depth"]["depth_scale"] = 0.0005
    (tmp_path / "cameras.json").write_text(json.dumps(cameras))
    frame = find_frames(tmp_path)[0].read()
    assert (frame.intrinsics.fx, frame.units_per_metre) == (60.0, 2000.0)


def test_camera_files_of_two_views_with_two_units_are_refused(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "0_color.png", tmp_path / "0_aligned_depth.png", None)
    write_cameras(tmp_path, "color_lens.json", "depth_lens.json")
    of_depth = json.loads((tmp_path / "depth_lens.json").read_text())
    (tmp_path / "depth_lens.json").write_text(json.dumps(of_depth | {"depth_scale": 0.0005}))
    with pytest.raises(FormatError, match=r"color_lens\.json and .*depth_lens\.json"):
        find_frames(tmp_path)[0].read()
