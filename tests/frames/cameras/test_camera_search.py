"""Camera files under other names: found by their content, or named in the error."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.frames.cameras import camera_search
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.cameras.camera_search import MOST_BYTES, MOST_FILES, find_camera_file
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.pairing import image_names
from tests.frames.layouts import build

NAMED = {"fx": 60.0, "fy": 61.0, "cx": 23.5, "cy": 17.5}


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A frame without a camera file."""
    build.pair(tmp_path / "0_color.png", tmp_path / "0_depth.png", 0)
    return tmp_path


def refusal(folder: Path) -> str:
    with pytest.raises(FormatError, match="no intrinsics are known") as caught:
        find_frames(folder)[0].read()
    return str(caught.value)


@pytest.mark.parametrize("name", ["left_sensor.json", "calib.yml", "lens.txt", "matrix.npy"])
def test_a_camera_file_is_found_under_any_name(bare: Path, name: str) -> None:
    path = bare / name
    if name.endswith(".npy"):
        np.save(path, build.K)
    elif name.endswith(".txt"):
        np.savetxt(path, build.K)
    else:
        path.write_text(json.dumps(NAMED))
    assert find_frames(bare)[0].read().intrinsics.fx == build.FOUR[0]


def test_files_of_poses_and_labels_are_not_taken_for_cameras(bare: Path) -> None:
    np.savetxt(bare / "pose.txt", np.eye(4))
    (bare / "labels.json").write_text(json.dumps({"K": "many"}))
    assert find_camera_file(bare, "0") is None
    assert "no camera was found in labels.json, pose.txt" in refusal(bare)


def test_files_one_folder_up_that_hold_no_camera_are_named(tmp_path: Path) -> None:
    build.pair(tmp_path / "rgb" / "0.png", tmp_path / "depth" / "0.png", 0)
    (tmp_path / "calibration.toml").write_text("")
    assert "no camera was found in calibration.toml" in refusal(tmp_path)


def test_a_camera_in_the_folder_of_all_scenes_is_named(tmp_path: Path) -> None:
    scene = tmp_path / "scene_1"
    build.pair(scene / "rgb" / "0.png", scene / "depth" / "0.png", 0)
    build.write(tmp_path / "camera.json", NAMED)
    assert f"--intrinsics {tmp_path / 'camera.json'}, which holds a camera" in refusal(tmp_path)


def test_many_frames_without_a_camera_list_their_folder_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in "0123":
        build.pair(tmp_path / f"{name}_color.png", tmp_path / f"{name}_depth.png", 0)
    frames, listed = find_frames(tmp_path), []
    list_folder = Path.iterdir
    monkeypatch.setattr(Path, "iterdir", lambda path: listed.append(path) or list_folder(path))
    for counts in ([1, 0, 0, 0], [1, 0, 0, 0]):
        for frame, count in zip(frames, counts, strict=True):
            listed.clear()
            with pytest.raises(FormatError, match="no intrinsics are known"):
                frame.read()
            assert (tmp_path in listed) == count
        (tmp_path / "notes.txt").write_text("a new file, which the advice names")
    assert "no camera was found in notes.txt" in refusal(tmp_path)


@pytest.mark.parametrize("name", ["0.json", "0_color.json"])
@pytest.mark.parametrize("labels", [{"shapes": []}, [1, 2], {"picture": "x" * MOST_BYTES, "fx": 1}])
def test_labels_beside_a_frame_do_not_hide_the_folders_camera(
    bare: Path, name: str, labels: object
) -> None:
    (bare / "camera.json").write_text(json.dumps(NAMED))
    (bare / name).write_text(json.dumps(labels))
    assert find_frames(bare)[0].read().intrinsics.fx == build.FOUR[0]


@pytest.mark.parametrize("text", ['{"fx": 60.0}', '{"K": [1, 2]}', '{"fx": 6'])
def test_a_faulty_camera_of_a_frame_is_reported_and_not_replaced(bare: Path, text: str) -> None:
    (bare / "camera.json").write_text(json.dumps(NAMED))
    (bare / "0.json").write_text(text)
    with pytest.raises(FormatError, match=r"0\.json"):
        find_frames(bare)[0].read()


def test_two_possible_cameras_are_both_named_and_neither_is_taken(bare: Path) -> None:
    for name, fx in (("a.json", 60.0), ("b.json", 70.0)):
        (bare / name).write_text(json.dumps(NAMED | {"fx": fx}))
    found = refusal(bare)
    assert f"one of {bare / 'a.json'} and {bare / 'b.json'}: that of the depth" in found
    assert f"--intrinsics {bare}" not in found  # neither is proposed, as it may be the wrong one
    (bare / "b.json").write_text(json.dumps(NAMED))
    assert find_camera_file(bare, "0") == bare / "a.json"


def test_a_camera_one_folder_up_is_named(bare: Path) -> None:
    build.pair(bare / "run/x_color.png", bare / "run/x_depth.png", 0)
    (bare / "cell.json").write_text(json.dumps(NAMED))
    assert f"--intrinsics {bare / 'cell.json'}" in refusal(bare / "run")


def test_files_that_exist_for_each_frame_are_not_searched(bare: Path) -> None:
    for i in range(MOST_FILES + 1):
        (bare / f"labels_{i}.json").write_text(json.dumps(NAMED))
    assert find_camera_file(bare, "0") is None


def test_a_listing_looks_at_few_of_many_files_and_splits_each_name_once(
    bare: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for i in range(3 * MOST_FILES):
        (bare / f"labels_{i}.json").write_text("{}")
    find_frames(bare)
    misses, looked, stat = image_names.word_and_rest.cache_info().misses, list[str](), Path.stat

    def counted(path: Path, **options: bool) -> os.stat_result:
        looked.append(path.name)
        return stat(path, **options)

    monkeypatch.setattr(Path, "stat", counted)
    camera_search.shared_camera_file(bare)
    assert sum(name.startswith("labels_") for name in looked) <= 2 * (MOST_FILES + 1)
    find_frames(bare)
    assert image_names.word_and_rest.cache_info().misses == misses


def test_camera_files_that_are_not_there_are_not_looked_for_frame_by_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for i in range(9):
        build.pair(tmp_path / f"{i}_color.png", tmp_path / f"{i}_depth.png", i)
    (tmp_path / "camera.json").write_text(json.dumps(NAMED))
    (tmp_path / "8_camera.json").write_text(json.dumps(NAMED))
    looked, stat = [], Path.stat

    def counted(path: Path, **options: bool) -> os.stat_result:
        looked.append(path.name)
        return stat(path, **options)

    monkeypatch.setattr(Path, "stat", counted)
    sources = find_frames(tmp_path)
    assert [source.files[2].name for source in sources][7:] == ["camera.json", "8_camera.json"]
    assert not {"0_camera.json", "0_color_camera.json", "0.mat", "0.json"} & set(looked)


def test_the_shared_camera_info_is_read(shared: Path) -> None:
    frame = find_frames(shared / "cases/camera_info_json")[0].read()
    assert frame.intrinsics.fx == pytest.approx(517.62, abs=0.01)
    assert frame.removed is not None


def cameras(folder: Path, **lengths: float) -> None:
    for image, fx in lengths.items():
        (folder / f"{image}_camera.json").write_text(json.dumps(NAMED | {"fx": fx}))


def test_a_frame_with_two_cameras_is_refused_unless_they_are_equal(tmp_path: Path) -> None:
    build.pair(tmp_path / "color.png", tmp_path / "depth.png", 0)
    cameras(tmp_path, color=70.0, depth=60.0)
    with pytest.raises(FormatError, match=r"depth_camera.json are two cameras.*--intrinsics"):
        find_frames(tmp_path)[0].read()
    stated = FrameOptions(CameraFile(*build.FOUR))
    assert find_frames(tmp_path, stated)[0].read().intrinsics.fx == build.FOUR[0]
    cameras(tmp_path, color=60.2)  # as rounded by another program
    assert find_frames(tmp_path)[0].read().intrinsics.fx == 60.2


def test_the_camera_file_of_the_depth_image_is_read(tmp_path: Path) -> None:
    build.pair(tmp_path / "0_color.png", tmp_path / "0_depth.png", 0)
    cameras(tmp_path, **{"0_depth": 65.0})
    assert find_frames(tmp_path)[0].read().intrinsics.fx == 65.0


@pytest.mark.parametrize("name", ["cameras/0.json", "camera_params_0.json", "camera_0.json"])
def test_the_camera_of_a_frame_may_be_in_a_folder_or_begin_with_the_word(
    tmp_path: Path, name: str
) -> None:
    build.pair(tmp_path / "images/0.png", tmp_path / "depth/0.png", 0)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(json.dumps(NAMED))
    assert find_frames(tmp_path)[0].read().intrinsics.fx == build.FOUR[0]


def test_the_camera_of_isaac_sim_is_that_of_its_lens(tmp_path: Path) -> None:
    build.pair(tmp_path / "rgb_0.png", tmp_path / "depth_0.png", 0)
    lens = {"cameraAperture": [20.955, 15.7], "cameraFocalLength": 24, "cameraModel": "pinhole"}
    size = [build.WIDTH, build.HEIGHT]
    path = tmp_path / "camera_params_0.json"
    path.write_text(json.dumps(lens | {"renderProductResolution": size}))
    camera = find_frames(tmp_path)[0].read().intrinsics
    assert camera.fx == camera.fy == pytest.approx(48 * 24 / 20.955)
    assert (camera.cx, camera.cy) == (23.5, 17.5)
    lens["cameraModel"] = "fisheyePolynomial"
    path.write_text(json.dumps(lens | {"renderProductResolution": size}))
    with pytest.raises(FormatError):
        find_frames(tmp_path)[0].read()


def test_a_file_of_several_cameras_is_described_as_such(bare: Path) -> None:
    content = {"color": NAMED, "depth": NAMED | {"fx": 70.0}, "serial": 7}
    (bare / "intrinsics.json").write_text(json.dumps(content))
    with pytest.raises(FormatError, match=r"holds the cameras color, depth; give that"):
        find_frames(bare)[0].read()


def test_two_equal_cameras_in_one_file_are_one(bare: Path) -> None:
    build.write(bare / "camera.json", {"color": NAMED, "depth": NAMED})
    assert find_frames(bare)[0].read().intrinsics.fx == build.FOUR[0]


@pytest.mark.parametrize("suffix", [".json", ".xml", ".txt"])
def test_labels_of_many_frames_do_not_hide_a_camera_with_another_suffix(
    bare: Path, suffix: str
) -> None:
    for i in range(MOST_FILES + 1):
        (bare / f"labels_{i}{suffix}").write_text("{}")
    (bare / "lens.yaml").write_text(json.dumps(NAMED))
    assert find_camera_file(bare, "0") == bare / "lens.yaml"


@pytest.mark.parametrize("text", ["[60, 61, 23.5, 17.5]", "- 60\n- 61\n- 23.5\n- 17.5\n"])
def test_a_bare_list_of_four_is_a_camera_only_under_a_name_of_one(bare: Path, text: str) -> None:
    (bare / "box.yaml").write_text(text)
    assert "no camera was found in box.yaml" in refusal(bare)
    (bare / "box.yaml").rename(bare / "lens.yaml")
    assert find_frames(bare)[0].read().intrinsics.fx == build.FOUR[0]


def test_an_array_of_four_is_a_camera_only_under_a_name_of_one(bare: Path) -> None:
    np.save(bare / "box.npy", np.array(build.FOUR))
    assert "no camera was found in box.npy" in refusal(bare)
    (bare / "box.npy").rename(bare / "intrinsics.npy")
    assert np.array_equal(find_frames(bare)[0].read().intrinsics.matrix, build.K)


def oak(scale: float = 1.0, fx: float = 60.0, model: int = 0) -> dict[str, object]:
    """One camera in the calibration of an OAK, of images `scale` times as large."""
    matrix = np.diag([scale, scale, 1.0]) @ build.K
    matrix[0, 0] = fx * scale
    size = {"width": int(build.WIDTH * scale), "height": int(build.HEIGHT * scale)}
    lens = {"cameraType": model, "distortionCoeff": [0.0] * 14}
    return size | lens | {"intrinsicMatrix": matrix.tolist(), "extrinsics": {"toCameraSocket": 1}}


UNUSED = oak() | {"width": 0, "height": 0, "intrinsicMatrix": np.zeros((3, 3)).tolist()}


def test_the_only_camera_of_an_oak_is_resized_to_the_images(bare: Path) -> None:
    build.write(bare / "calib.json", {"cameraData": [[1, UNUSED], [0, oak(2.0)]], "version": 7})
    camera = find_frames(bare)[0].read().intrinsics
    assert camera.fx == build.FOUR[0]
    assert camera.width == build.WIDTH


def test_of_the_cameras_of_an_oak_that_of_aligned_depth_is_taken(tmp_path: Path) -> None:
    build.pair(tmp_path / "0_color.png", tmp_path / "0_depth_aligned.png", 0)
    cameras = [[2, oak(1.0, 70.0)], [0, oak()], [1, oak(1.0, 71.0)]]
    build.write(tmp_path / "calib.json", {"cameraData": cameras})
    assert find_frames(tmp_path)[0].read().intrinsics.fx == build.FOUR[0]
    (tmp_path / "0_depth_aligned.png").rename(tmp_path / "0_depth.png")
    assert "calib.json: holds the cameras right, color, left; give" in refusal(tmp_path)


def test_the_fisheye_lens_of_an_oak_is_known_as_such(bare: Path) -> None:
    camera = oak(model=1) | {"distortionCoeff": [0.05, 0.01, 0.0, 0.0] + [0.0] * 10}
    build.write(bare / "calib.json", {"cameraData": [[0, camera]]})
    assert any("fisheye" in note for note in find_frames(bare)[0].read().notes)


@pytest.mark.parametrize("name", ["bbox.txt", "crop.csv"])
def test_four_bare_numbers_are_a_camera_only_under_a_name_of_one(bare: Path, name: str) -> None:
    (bare / name).write_text("60, 61, 23.5, 17.5\n")
    assert f"no camera was found in {name}" in refusal(bare)
    (bare / name).rename(bare / f"my_camera_{name}")
    assert find_frames(bare)[0].read().intrinsics.fx == build.FOUR[0]
    (bare / f"my_camera_{name}").rename(bare / name)
    (bare / name).write_text("fx=60 fy=61 cx=23.5 cy=17.5\n")
    assert find_frames(bare)[0].read().intrinsics.fx == build.FOUR[0]
