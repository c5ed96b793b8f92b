"""Files with the name of an image of a frame, next to a recording."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.frames.frames import find_frames

Save = Callable[..., None]
PICTURE = np.zeros((9, 9, 3), np.uint8)


def stray(path: Path) -> None:
    if path.suffix == ".npy":
        np.save(path, np.eye(3))
    else:
        cv2.imwrite(str(path), PICTURE)


def recording(folder: Path, save: Save) -> None:
    save(folder / "color" / "x.png", folder / "depth" / "x.png", folder / "camera.json")


@pytest.mark.parametrize("name", ["depth_preview.png", "color_chart.png", "depth_scale.npy"])
def test_a_picture_named_after_colour_or_depth_hides_no_recording(
    tmp_path: Path, save: Save, name: str
) -> None:
    for place in ("one", "two"):
        recording(tmp_path / place, save)
        stray(tmp_path / place / name)
    stray(tmp_path / name)
    assert [source.name for source in find_frames(tmp_path)] == ["one/x", "two/x"]
    assert find_frames(tmp_path)[0].read().depth.max() > 0


def test_a_folder_of_images_without_partners_hides_no_folders_below(
    tmp_path: Path, save: Save
) -> None:
    for name in ("rgb/x.png", "depth/y.png"):
        (tmp_path / name).parent.mkdir()
        stray(tmp_path / name)
    np.save(tmp_path / "camK.npy", np.eye(3))
    recording(tmp_path / "again", save)
    assert [source.name for source in find_frames(tmp_path)] == ["again/x"]


def test_images_without_partners_are_reported_where_nothing_else_is_found(tmp_path: Path) -> None:
    for name in ("rgb/rgb_1.png", "depth/depth_2.png"):
        (tmp_path / name).parent.mkdir()
        stray(tmp_path / name)
    sources = find_frames(tmp_path)
    assert [source.name for source in sources] == ["depth_2", "rgb_1"]
    with pytest.raises(FormatError, match="has no colour image next to it"):
        sources[0].read()


def test_a_frame_without_its_partner_is_reported_among_other_folders(
    tmp_path: Path, save: Save
) -> None:
    for place in ("one", "two"):
        folder = tmp_path / place
        save(folder / "color.png", folder / "depth.png", folder / "camera.json")
    (tmp_path / "two" / "depth.png").unlink()
    whole, broken = find_frames(tmp_path)
    assert whole.read().name == "one"
    with pytest.raises(FormatError, match="has no depth image next to it"):
        broken.read()


@pytest.mark.parametrize("name", ["depth_intrinsics.npy", "depth_camera_matrix.npy", "depth_K.npy"])
def test_arrays_of_facts_are_no_depth_of_flat_pairs(flat: Path, name: str) -> None:
    stray(flat / name)
    assert [source.name for source in find_frames(flat)] == ["a", "b"]


def test_depth_of_a_frame_that_is_named_after_a_fact_is_read(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "color_scale.png", tmp_path / "depth_scale.npy", tmp_path / "camera.json")
    assert [source.read().name for source in find_frames(tmp_path)] == ["scale"]


def test_a_folder_of_scenes_that_are_not_graspnets_hides_no_folders_next_to_it(
    tmp_path: Path, save: Save
) -> None:
    for place in ("kitchen", "scenes/one"):
        recording(tmp_path / place, save)
    assert [source.name for source in find_frames(tmp_path)] == ["kitchen/x", "scenes/one/x"]


@pytest.mark.parametrize(
    "name",
    [
        "depth1-gt.png",
        "depth1-gt-mask.png",
        "depth_1_colormap.png",
        "rgb1_annotated.png",
        "depth_vis_1.png",
    ],
)
def test_further_pictures_of_a_frame_are_no_frames(tmp_path: Path, save: Save, name: str) -> None:
    save(tmp_path / "rgb1.png", tmp_path / "depth1.png", tmp_path / "camera.json")
    stray(tmp_path / name)
    assert [source.name for source in find_frames(tmp_path)] == ["1"]


@pytest.mark.parametrize(
    "name", ["depth1_2.png", "depth12.png", "1_left_color.png", "left_1_color.png"]
)
def test_an_image_of_another_frame_is_still_reported(tmp_path: Path, save: Save, name: str) -> None:
    save(tmp_path / "rgb1.png", tmp_path / "depth1.png", tmp_path / "camera.json")
    stray(tmp_path / name)
    assert len(find_frames(tmp_path)) == 2
