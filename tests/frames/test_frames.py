"""Finding and reading RGB-D frames in every layout, and refusing faulty ones."""

import json
import logging
import os
import pickle
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.geometry.camera import Intrinsics

WIDTH, HEIGHT = 64, 48
K = np.array([[60.0, 0.0, 31.5], [0.0, 61.0, 23.5], [0.0, 0.0, 1.0]])
Save = Callable[..., None]
PAIRS = [
    ("x_color.png", "x_depth.png"),
    ("x-color.png", "x-depth.png"),
    ("x.color.png", "x.depth.png"),
    ("x_Color.png", "x_Depth.png"),
    ("x.rgb.png", "x.depth.png"),
    ("x_color.jpg", "x_depth.png"),
    ("color_x.png", "depth_x.png"),
    ("color_x.png", "depth_x.npy"),
    ("rgb_x.png", "depth_x.png"),
    ("frame-x.color.jpg", "frame-x.depth.png"),
    ("color_image.png", "depth_image.png"),
    ("image_rgb.png", "image_depth.png"),
    ("rgb.png", "depth.png"),
    ("image.png", "depth.npy"),
    ("rgb/x.png", "depth/x.png"),
    ("color/x.jpg", "depth/x.png"),
]


def only_error(folder: Path, *stated: FrameOptions) -> str:
    sources = find_frames(folder, *stated)
    assert len(sources) == 1
    with pytest.raises(SymgraspError) as caught:
        sources[0].read()
    return str(caught.value)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("x_color.png", "x_depth.png"), ("x-color.png", "x-depth.png")),
        (("color_x.png", "depth_x.png"), ("x_color.png", "x_depth.png")),
        (("rgb/x.png", "depth/x.png"), ("rgb/x.PNG", "depth/y.png")),
    ],
)
def test_two_frames_of_the_same_name_are_refused_and_neither_is_dropped(
    tmp_path: Path, save: Save, first: tuple[str, str], second: tuple[str, str]
) -> None:
    for color, depth in (first, second):
        save(tmp_path / color, tmp_path / depth, tmp_path / "intrinsics.json")
    found = {source.name: source for source in find_frames(tmp_path)}
    with pytest.raises(FormatError, match=r"are one frame by their names; give each frame"):
        found["x"].read()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names")
def test_a_name_that_is_not_utf8_is_read_and_can_be_written_as_text(
    tmp_path: Path, save: Save
) -> None:
    save(tmp_path / "x_color.png", tmp_path / "x_depth.png", tmp_path / "camera.json")
    for kind in ("color", "depth"):
        (tmp_path / f"x_{kind}.png").rename(
            tmp_path / os.fsdecode(b"caf\xe9_%b.png" % kind.encode())
        )
    (source,) = find_frames(tmp_path)
    assert source.name == source.read().name == "caf%E9"


@pytest.mark.parametrize(
    "stray", ["rgb/._x.png", "rgb/.x.png", "depth/._y.png", "._x_color.png", "._x.npz", "._x.pcd"]
)
def test_hidden_files_of_other_systems_are_not_read_as_frames(
    tmp_path: Path, save: Save, stray: str
) -> None:
    save(tmp_path / "rgb/x.png", tmp_path / "depth/x.png", tmp_path / "intrinsics.json")
    (tmp_path / stray).write_bytes(b"Mac OS X")
    (source,) = find_frames(tmp_path)
    assert source.read().name == "x"


def test_a_picture_in_two_formats_is_one_frame(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "rgb/x.jpg", tmp_path / "depth/x.png", tmp_path / "intrinsics.json")
    save(tmp_path / "rgb/x.png", tmp_path / "depth/x.npy", tmp_path / "intrinsics.json")
    (source,) = find_frames(tmp_path)
    assert {path.name for path in source.files} >= {"x.png"}
    assert all(path.suffix in (".png", ".json") for path in source.files)
    source.read()


@pytest.mark.parametrize(("color_name", "depth_name"), PAIRS)
def test_common_names_are_paired(
    tmp_path: Path, save: Save, depth: np.ndarray, color_name: str, depth_name: str
) -> None:
    save(tmp_path / color_name, tmp_path / depth_name, tmp_path / "intrinsics.json")
    (source,) = find_frames(tmp_path)
    frame = source.read()
    expected = np.where(depth == 65535, 0, depth) / 1000.0
    assert_allclose(frame.depth, expected, rtol=1e-6)
    assert frame.intrinsics == Intrinsics(60.0, 61.0, 31.5, 23.5, WIDTH, HEIGHT)
    assert frame.name == source.name


def test_frames_are_named_and_sorted(flat: Path, color: np.ndarray) -> None:
    sources = find_frames(flat)
    assert [source.name for source in sources] == ["a", "b"]
    assert_array_equal(sources[0].read().color, color)


@pytest.mark.parametrize("chosen", [{"camera": "kinect"}, {"scenes": range(100)}])
def test_a_split_or_camera_of_a_folder_without_scenes_is_refused(
    flat: Path, chosen, tmp_path_factory
) -> None:
    with pytest.raises(SymgraspError, match=r"holds no GraspNet scenes .* leave out --split"):
        find_frames(flat, **chosen)
    root = tmp_path_factory.mktemp("root")
    (root / "scenes").mkdir()
    flat.rename(root / "scenes" / "scene_0007")
    assert len(find_frames(root, **chosen)) == 2


def test_a_choice_without_frames_is_refused_as_a_choice(scene_root: Path) -> None:
    for folder in (scene_root, scene_root / "scenes" / "scene_0100" / "kinect"):
        with pytest.raises(SymgraspError, match="of this --split and --camera; name others"):
            find_frames(folder, camera="realsense", scenes=range(5))


def test_a_choice_in_a_folder_with_a_damaged_index_is_refused(tmp_path: Path) -> None:
    (tmp_path / "transforms.json").write_text("{")
    with pytest.raises(SymgraspError, match="holds no GraspNet scenes"):
        find_frames(tmp_path, camera="kinect")


@pytest.mark.parametrize(
    ("folder", "given"),
    [(".", "x_color.png"), ("below", "../x_color.png"), (".", "./x_depth.png")],
)
def test_a_file_of_the_working_folder_is_one_frame(
    tmp_path: Path, save: Save, monkeypatch: pytest.MonkeyPatch, folder: str, given: str
) -> None:
    save(tmp_path / "x_color.png", tmp_path / "x_depth.png", tmp_path / "x_camera.json")
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / folder)
    assert [source.name for source in find_frames(Path(given))] == ["x"]


def test_an_image_of_the_working_folder_finds_its_sister_folder(
    tmp_path: Path, save: Save, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(tmp_path / "rgb" / "7.png", tmp_path / "depth" / "7.png", tmp_path / "camera.json")
    monkeypatch.chdir(tmp_path / "rgb")
    (source,) = find_frames(Path("7.png"))
    assert source.read().depth.shape == (HEIGHT, WIDTH)


def test_a_picture_of_the_depth_is_not_taken_for_colour(flat: Path, color: np.ndarray) -> None:
    cv2.imwrite(str(flat / "a_depth_color.png"), color)
    assert [source.name for source in find_frames(flat)] == ["a", "b"]


def test_sources_can_be_sent_to_other_processes(flat: Path) -> None:
    source = pickle.loads(pickle.dumps(find_frames(flat)[0]))
    assert source.read().name == "a"


def test_folders_of_folders_give_relative_names(tmp_path: Path, save: Save) -> None:
    for place in ("one", "two/deep"):
        folder = tmp_path / place
        save(folder / "x_color.png", folder / "x_depth.png", folder / "x_camera.json")
    # Folders next to frames are not searched: they hold native copies, masks and overlays.
    save(tmp_path / "one/native/y_color.png", tmp_path / "one/native/y_depth.png", None)
    assert [source.name for source in find_frames(tmp_path)] == ["one/x", "two/deep/x"]


def test_a_link_to_a_folder_above_ends_the_search(tmp_path: Path, save: Save) -> None:
    folder = tmp_path / "one"
    save(folder / "x_color.png", folder / "x_depth.png", None)
    (tmp_path / "again").symlink_to(tmp_path)
    assert [source.name for source in find_frames(tmp_path)] == ["one/x"]


def test_folders_that_link_to_each_other_are_searched_once(tmp_path: Path, save: Save) -> None:
    folders = [tmp_path / name for name in "abcd"]
    save(folders[0] / "x_color.png", folders[0] / "x_depth.png", folders[0] / "camera.json")
    for folder in folders[1:]:
        folder.mkdir()
        for other in folders[1:]:
            if other != folder:
                (folder / f"to_{other.name}").symlink_to(other)
    assert [source.name for source in find_frames(tmp_path)] == ["a/x"]


def test_a_link_to_itself_is_passed_over(tmp_path: Path, save: Save) -> None:
    below = tmp_path / "below"
    save(below / "x_color.png", below / "x_depth.png", None)
    (tmp_path / "loop").symlink_to("loop")
    assert [source.name for source in find_frames(tmp_path)] == ["below/x"]


def test_a_demo_folder_is_named_after_itself(tmp_path: Path, save: Save) -> None:
    folder = tmp_path / "demo"
    save(folder / "color.png", folder / "depth.png", None)
    scipy.io.savemat(
        folder / "meta.mat", {"intrinsic_matrix": K, "factor_depth": np.array([[2000.0]])}
    )
    cv2.imwrite(str(folder / "workspace_mask.png"), np.full((HEIGHT, WIDTH), 255, np.uint8))
    (source,) = find_frames(folder)
    frame = source.read()
    assert frame.name == "demo"
    assert_allclose(frame.depth[0, 2], 0.35)
    assert [s.name for s in find_frames(tmp_path)] == ["demo"]


@pytest.fixture
def scene_root(tmp_path: Path, save: Save) -> Path:
    for camera in ("kinect", "realsense"):
        folder = tmp_path / "scenes/scene_0100" / camera
        for frame in ("0000", "0001"):
            save(folder / "rgb" / f"{frame}.png", folder / "depth" / f"{frame}.png", None)
        np.save(folder / "camK.npy", K)
    (tmp_path / "models/000").mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize(
    ("below", "prefix"),
    [("", "scenes/scene_0100/realsense/"), ("scenes", "scene_0100/realsense/"),
     ("scenes/scene_0100", "realsense/"), ("scenes/scene_0100/realsense", "")],
)  # fmt: skip
def test_graspnet_trees_are_read_from_any_level(scene_root: Path, below: str, prefix: str) -> None:
    sources = find_frames(scene_root / below, camera="realsense")
    assert [source.name for source in sources] == [f"{prefix}0000", f"{prefix}0001"]
    assert sources[1].read().intrinsics.fx == 60.0


def test_every_camera_is_read_unless_one_is_chosen(scene_root: Path) -> None:
    assert len(find_frames(scene_root)) == 4


def test_a_folder_without_frames_is_refused_with_the_expected_names(tmp_path: Path) -> None:
    (tmp_path / "holiday.jpg").write_bytes(b"")
    with pytest.raises(SymgraspError, match=r"no RGB-D frames.*_color\.png"):
        find_frames(tmp_path)
    with pytest.raises(SymgraspError, match="part of no RGB-D frame"):
        find_frames(tmp_path / "holiday.jpg")


def test_a_frame_without_intrinsics_is_refused_with_the_option_for_them(
    tmp_path: Path, save: Save
) -> None:
    save(tmp_path / "x_color.png", tmp_path / "x_depth.png", None)
    assert "--intrinsics" in only_error(tmp_path)


def test_stated_intrinsics_and_units_win_over_files(flat: Path) -> None:
    camera = Intrinsics(70.0, 70.0, 32.0, 24.0, WIDTH, HEIGHT)
    frame = find_frames(flat, FrameOptions(CameraFile.of(camera), 2000.0))[0].read()
    assert frame.intrinsics == camera
    assert_allclose(frame.depth[0, 2], 0.35)


@pytest.mark.parametrize("units", [0.0, -1000.0, float("nan"), float("inf")])
def test_wrong_units_are_refused(flat: Path, units: float) -> None:
    with pytest.raises(SymgraspError, match="--depth-units-per-metre is"):
        find_frames(flat, FrameOptions(None, units))


def test_intrinsics_of_another_size_are_refused(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "x_color.png", tmp_path / "x_depth.png", None)
    other = Intrinsics(120.0, 120.0, 64.0, 48.0, 128, 96)
    assert "128x96" in only_error(tmp_path, FrameOptions(CameraFile.of(other)))
    unsized = CameraFile(120.0, 120.0, 64.0, 48.0)
    error = only_error(tmp_path, FrameOptions(unsized))
    assert "principal point" in error
    assert "multiply those of a larger image by the ratio of the sizes" in error


def test_a_missing_partner_fails_its_frame_alone(flat: Path) -> None:
    (flat / "a_depth.png").unlink()
    (flat / "b_color.png").rename(flat / "c_color.png")
    failures = {}
    for source in find_frames(flat):
        with pytest.raises(FormatError) as caught:
            source.read()
        failures[source.name] = str(caught.value)
    assert "a_color.png: has no depth" in failures["a"]
    assert "b_depth.png: has no colour" in failures["b"]


def test_a_truncated_png_fails_alone(flat: Path) -> None:
    data = (flat / "a_depth.png").read_bytes()
    (flat / "a_depth.png").write_bytes(data[: len(data) // 2])
    first, second = find_frames(flat)
    with pytest.raises(FormatError, match=r"a_depth\.png"):
        first.read()
    assert second.read().name == "b"


@pytest.mark.parametrize(
    ("stored", "sentence"),
    [
        (np.full((HEIGHT, WIDTH, 3), 90, np.uint8), "3 channels"),
        (np.full((HEIGHT, WIDTH), 90, np.uint8), "8 bits"),
        (np.zeros((HEIGHT, WIDTH), np.uint16), "missing"),
        (np.full((HEIGHT, WIDTH), 65535, np.uint16), "saturated"),
        (np.full((HEIGHT, WIDTH), 7000, np.uint16), "0.7 m under 10000"),
        (np.full((HEIGHT, WIDTH), 40, np.uint16), "40 m under 1"),
    ],
)
def test_images_that_cannot_be_depth_are_refused(
    flat: Path, stored: np.ndarray, sentence: str
) -> None:
    cv2.imwrite(str(flat / "a_depth.png"), stored)
    with pytest.raises(FormatError, match=r"a_depth\.png") as caught:
        find_frames(flat)[0].read()
    assert sentence in str(caught.value)


@pytest.mark.parametrize("millimetres", [70, 135])
def test_close_depth_of_a_wrist_camera_is_accepted(flat: Path, millimetres: int) -> None:
    cv2.imwrite(str(flat / "a_depth.png"), np.full((HEIGHT, WIDTH), millimetres, np.uint16))
    frame = find_frames(flat)[0].read()
    assert_allclose(frame.depth, millimetres / 1000)
    (note,) = frame.notes
    assert f"about {millimetres / 1000:.2g} m, closer than most cameras measure" in note


def test_close_depth_that_another_unit_explains_better_needs_a_stated_unit(flat: Path) -> None:
    cv2.imwrite(str(flat / "a_depth.png"), np.full((HEIGHT, WIDTH), 1000, np.uint16))
    in_file = CameraFile(60.0, 61.0, 31.5, 23.5, units_per_metre=10000.0)
    with pytest.raises(FormatError, match="1 m under 1000"):
        find_frames(flat, FrameOptions(in_file))[0].read()
    frame = find_frames(flat, FrameOptions(in_file, 10000.0))[0].read()
    assert_allclose(frame.depth, 0.1)


def test_a_far_background_does_not_hide_a_near_table(flat: Path) -> None:
    stored = np.full((HEIGHT, WIDTH), 9000, np.uint16)
    stored[: HEIGHT // 2] = 800
    cv2.imwrite(str(flat / "a_depth.png"), stored)
    assert find_frames(flat)[0].read().depth.max() == 9.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 0.0])
def test_every_kind_of_missing_float_depth_reads_as_zero(
    tmp_path: Path, save: Save, bad: float
) -> None:
    save(tmp_path / "color_x.png", tmp_path / "depth_x.npy", tmp_path / "camera.json")
    metres = np.full((HEIGHT, WIDTH, 1), 0.6, np.float32)
    metres[3, 4] = bad
    np.save(tmp_path / "depth_x.npy", metres)
    frame = find_frames(tmp_path)[0].read()
    assert frame.depth.shape == (HEIGHT, WIDTH)
    assert (frame.depth == 0).sum() == 1


def test_colour_of_twice_the_size_is_resampled_and_reported(
    flat: Path, color: np.ndarray, caplog: pytest.LogCaptureFixture
) -> None:
    twice = np.repeat(np.repeat(color, 2, axis=0), 2, axis=1)
    cv2.imwrite(str(flat / "a_color.png"), twice[:, :, ::-1])
    with caplog.at_level(logging.INFO):
        frame = find_frames(flat)[0].read()
    assert_array_equal(frame.color, color)
    assert "128x96" in caplog.text


@pytest.mark.parametrize("size", [(240, 180), (40, 30)])  # 3.75 times the depth, as of phones
def test_colour_of_any_multiple_of_the_depths_size_is_resampled(
    flat: Path, color: np.ndarray, size: tuple[int, int]
) -> None:
    smooth = cv2.blur(color, (31, 31))
    picture = cv2.resize(smooth, size, interpolation=cv2.INTER_LINEAR)
    cv2.imwrite(str(flat / "a_color.png"), picture[:, :, ::-1])
    frame = find_frames(flat)[0].read()
    assert frame.notes == (f"colour of {size[0]}x{size[1]} is resampled to the depth",)
    assert np.abs(frame.color.astype(int) - smooth).max() <= 6


def test_colour_of_another_shape_is_refused(flat: Path, color: np.ndarray) -> None:
    cv2.imwrite(str(flat / "a_color.png"), color[:40])
    with pytest.raises(FormatError, match="64x40"):
        find_frames(flat)[0].read()


def test_a_broken_camera_file_fails_its_frame_alone(flat: Path) -> None:
    (flat / "a_camera.json").write_text(json.dumps({"fx": 60.0}))
    first, second = find_frames(flat)
    with pytest.raises(FormatError, match="lacks fy, cx, cy"):
        first.read()
    assert second.read().name == "b"


def test_every_real_frame_is_read(shared: Path) -> None:
    facts = {
        f"{fact['source']}/{fact['name']}": fact
        for fact in json.loads((shared / "frames/frames.json").read_text())
    }
    sources = find_frames(shared / "frames")
    assert len(sources) >= 24
    for source in sources[::4]:
        frame = source.read()
        fact = facts.get(source.name)
        if fact is None:  # only in its native form
            continue
        valid = frame.depth > 0
        assert_allclose(valid.mean(), fact["depth_valid"], atol=1e-3)
        assert_allclose(np.median(frame.depth[valid]), fact["depth_m_p1_p50_p99"][1], atol=2e-3)
        assert_allclose(frame.intrinsics.fx, fact["K"][0])


def test_a_real_graspnet_demo_folder_is_read(shared: Path) -> None:
    frame = find_frames(shared / "frames/graspnet_user")[0].read()
    assert frame.name == "native/graspnet_demo"
    assert frame.depth.shape == (720, 1280)
    assert frame.depth.max() < 65.0


@pytest.mark.parametrize(
    ("image", "partner", "name"),
    [
        ("color/color_0.png", "depth/depth_0.png", "0"),
        ("rgb/0_rgb.png", "depth/0_depth.png", "0"),
        ("rgb/7.png", "depth/7_depth.png", "7"),
        ("rgb/rgb7.png", "depth/depth7.png", "7"),
        ("color7.png", "depth7.png", "7"),
        ("RGB7_left.png", "Depth7_left.png", "7_left"),
        ("images/7.png", "depth_images/7.png", "7"),
        ("Image/7.png", "Depth_maps/7.png", "7"),
        ("rgb_left/7.png", "depth/7.png", "7"),
        ("left/7.png", "depth/7.png", "7"),
        ("images/frame_7.png", "depth/depth_7.png", "7"),
        ("images/frame7.png", "depth/7.png", "7"),
    ],
)
def test_the_words_may_be_in_the_names_in_two_folders_and_before_a_number(
    tmp_path: Path, save: Callable[..., None], image: str, partner: str, name: str
) -> None:
    save(tmp_path / image, tmp_path / partner, tmp_path / "camera.json")
    assert [source.read().name for source in find_frames(tmp_path)] == [name]


def test_of_two_folders_with_the_word_none_is_taken(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "images/7.png", tmp_path / "depth_maps/7.png", tmp_path / "camera.json")
    (tmp_path / "depth_colored").mkdir()
    with pytest.raises(SymgraspError, match="no pair by their names"):
        find_frames(tmp_path)


@pytest.mark.parametrize("other", ["depth_previews", "depth_scene"])
def test_a_folder_of_whole_frames_is_no_colour_of_a_folder_next_to_it(
    tmp_path: Path, save: Save, other: str
) -> None:
    names = ("x_color.png", "x_depth.png", "x_camera.json")
    save(*(tmp_path / "rgb_scene" / name for name in names))
    save(*(tmp_path / other / name for name in names))
    assert [source.name for source in find_frames(tmp_path)] == [f"{other}/x", "rgb_scene/x"]


def test_a_portable_float_map_is_depth_with_its_last_row_first(tmp_path: Path, save: Save) -> None:
    save(tmp_path / "x_color.png", None, tmp_path / "camera.json")
    metres = np.random.default_rng(0).uniform(0.5, 0.9, (HEIGHT, WIDTH)).astype("<f4")
    head = f"Pf\n{WIDTH} {HEIGHT}\n-1.0\n".encode()
    (tmp_path / "x_depth.pfm").write_bytes(head + metres[::-1].tobytes())
    assert_array_equal(find_frames(tmp_path)[0].read().depth, metres)
