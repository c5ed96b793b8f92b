"""Names by which colour and depth images are paired, as cameras and simulators write them."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.frames.frames import find_frames

Save = Callable[..., None]


def frame_of(folder: Path) -> tuple[str, bool]:
    """The name of the only frame, and whether depth is measured in it."""
    (source,) = find_frames(folder)
    return source.name, bool(source.read().depth.any())


@pytest.mark.parametrize(
    ("image", "measured", "name"),
    [
        ("image_0.png", "depth_0.png", "0"),
        ("img-7.jpg", "depth-7.png", "7"),
        ("frame0000.jpg", "depth0000.png", "0000"),  # of ROS's extract_images
        ("left000000.png", "depth000000.png", "000000"),  # of a ZED
        ("a_image.png", "a_depth.png", "a"),
        ("a.jpg", "a_depth.png", "a"),
        ("image_1.png", "depth_image_1.png", "image_1"),
        ("a_rgb.png", "a_depth_map.png", "a"),
        ("a_rgb.png", "a_DepthMap.tiff", "a"),
        ("a_color.webp", "a_depth.png", "a"),
        ("a_color.ppm", "a_depth.pgm", "a"),
        ("rgb_0000.png", "distance_to_image_plane_0000.npy", "0000"),  # of Isaac Sim
    ],
)
def test_images_with_these_names_are_one_frame(
    tmp_path: Path, save: Save, image: str, measured: str, name: str
) -> None:
    save(tmp_path / image, tmp_path / measured, tmp_path / "camera.json")
    assert frame_of(tmp_path) == (name, True)


@pytest.mark.parametrize("other", ["a.png", "a_image.png", "image_a.png"])
def test_colour_by_its_word_is_preferred_to_other_images(
    tmp_path: Path, save: Save, other: str
) -> None:
    save(tmp_path / "a_color.png", tmp_path / "a_depth.png", tmp_path / "camera.json")
    cv2.imwrite(str(tmp_path / other), np.zeros((9, 9), np.uint8))
    (source,) = find_frames(tmp_path)
    assert source.files[0].name == "a_color.png"


def test_ranges_along_the_ray_are_no_depth(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "rgb_0.png", tmp_path / "distance_to_camera_0.npy", tmp_path / "camera.json")
    assert not any(source.is_whole for source in find_frames(tmp_path))


@pytest.mark.parametrize(
    ("image", "measured"),
    [
        ("colors/0.png", "depths/0.png"),
        ("images/0.png", "depths/0.png"),
        ("color_images/color_0.png", "depth_images/depth_0.png"),
        ("rgb_undistort/0.png", "depth_undistort/0.png"),
        ("camera_color_image_raw/0.png", "camera_aligned_depth_to_color_image_raw/0.png"),
        ("rgb/rgb_0.png", "distance_to_image_plane/distance_to_image_plane_0.npy"),
    ],
)
def test_folders_with_these_names_are_sisters(
    tmp_path: Path, save: Save, image: str, measured: str
) -> None:
    save(tmp_path / image, tmp_path / measured, tmp_path / "camera.json")
    (tmp_path / "normals").mkdir()
    assert frame_of(tmp_path) == ("0", True)


def test_of_several_pairs_of_folders_none_is_preferred(tmp_path: Path, save: Save) -> None:
    for side in ("left", "right"):
        save(tmp_path / f"rgb_{side}/0.png", tmp_path / f"depth_{side}/0.png", None)
    with pytest.raises(Exception, match="are no pair by their names"):
        find_frames(tmp_path)


def test_measured_depth_is_preferred_to_depth_whose_holes_are_filled(
    tmp_path: Path, save: Save
) -> None:
    save(tmp_path / "color/0.png", tmp_path / "depth_filled/0.png", None)
    save(tmp_path / "color/0.png", tmp_path / "depth_raw/0.png", None)
    (source,) = find_frames(tmp_path)
    assert source.files[1] == tmp_path / "depth_raw/0.png"


def test_of_several_folders_of_colour_none_is_preferred(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "rgb_raw/0.png", tmp_path / "depth_raw/0.png", tmp_path / "camera.json")
    save(tmp_path / "color_raw/0.png", None, None)
    with pytest.raises(Exception, match="are no pair by their names"):
        find_frames(tmp_path)


@pytest.mark.parametrize("other", ["a_depth_map.png", "a_distance_to_image_plane.png"])
@pytest.mark.parametrize("measured", ["a_depth.png", "a_depth.npy"])
def test_depth_by_its_word_is_preferred_to_other_depth(
    tmp_path: Path, save: Save, measured: str, other: str
) -> None:
    save(tmp_path / "a_color.png", tmp_path / measured, tmp_path / "camera.json")
    cv2.imwrite(str(tmp_path / other), np.zeros((48, 64, 3), np.uint8))
    (source,) = find_frames(tmp_path)
    assert source.read().depth.any()


def test_an_image_by_a_weak_word_is_preferred_to_one_without_a_word(
    tmp_path: Path, save: Save
) -> None:
    save(tmp_path / "image_0.png", tmp_path / "depth_0.png", tmp_path / "camera.json")
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((48, 64), np.uint8))
    (source,) = find_frames(tmp_path)
    assert source.files[0].name == "image_0.png"


def test_of_several_images_by_weak_words_none_is_preferred(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "image_0.png", tmp_path / "depth_0.png", tmp_path / "camera.json")
    save(tmp_path / "frame_0.png", None, None)
    (source,) = find_frames(tmp_path)
    with pytest.raises(FormatError, match="are one frame by their names"):
        source.read()


@pytest.mark.parametrize("channels", [1, 3])
def test_a_picture_of_labels_is_not_taken_for_colour(
    tmp_path: Path, save: Save, channels: int
) -> None:
    save(tmp_path / "a.png", tmp_path / "a_depth.png", tmp_path / "camera.json")
    labels = np.zeros((48, 64, channels), np.uint8)
    labels[9:20, 9:30] = 200
    cv2.imwrite(str(tmp_path / "a.png"), labels)
    (source,) = find_frames(tmp_path)
    with pytest.raises(FormatError, match="has 2 colours, as a picture of labels"):
        source.read()
