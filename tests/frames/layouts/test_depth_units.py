"""The unit of the depth: the user's statement first, then the files', in every layout."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile, parse_camera
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.layouts.scannet import COLOR_CAMERA, DEPTH_CAMERA
from pipelines.frames.rgbd import DepthUnits
from tests.frames.layouts import build

UNITS = 2000.0
IN_FILE = CameraFile(*build.FOUR, units_per_metre=UNITS)
OF_FLOATS = {"gqcnn", "blenderproc", "contact_graspnet", "six_dof_graspnet", "pcd"}


@pytest.mark.parametrize("key", build.LAYOUTS)
def test_the_unit_in_the_stated_cameras_file_counts_in_every_layout(
    tmp_path: Path, key: str
) -> None:
    build.LAYOUTS[key][1](tmp_path)
    frame = find_frames(tmp_path, FrameOptions(IN_FILE))[0].read()
    if key in OF_FLOATS:  # floats are metres, whatever the unit of whole numbers
        assert frame.units_per_metre == 1.0
        return
    assert frame.units_per_metre == UNITS
    camera = CameraFile(*build.FOUR)
    stated = find_frames(tmp_path, FrameOptions(camera, UNITS))[0].read()
    assert_array_equal(frame.depth, stated.depth)


def test_whole_numbers_in_arrays_have_that_unit(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", depth=build.depth(0), K=build.K, rgb=build.color(0))
    assert find_frames(tmp_path)[0].read().units_per_metre == 1000.0
    frame = find_frames(tmp_path, FrameOptions(IN_FILE))[0].read()
    assert_array_equal(frame.depth, build.depth(0) / np.float32(UNITS))


def test_images_of_a_scan_with_both_cameras_have_that_unit(tmp_path: Path) -> None:
    build.scannet(tmp_path)
    shutil.copy(tmp_path / DEPTH_CAMERA, tmp_path / COLOR_CAMERA)
    assert find_frames(tmp_path, FrameOptions(IN_FILE))[0].read().units_per_metre == UNITS


def test_images_in_bags_have_that_unit(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    from tests.frames.layouts.test_rosbag import write_bag

    write_bag(tmp_path / "a")
    assert find_frames(tmp_path, FrameOptions(IN_FILE))[0].read().units_per_metre == UNITS


def test_a_camera_file_given_as_an_option_sets_the_unit(tmp_path: Path) -> None:
    build.nerfstudio(tmp_path)
    names = dict(zip(("fx", "fy", "cx", "cy"), build.FOUR, strict=True))
    (tmp_path / "l515.json").write_text(json.dumps(names | {"depth_scale": UNITS}))
    camera = parse_camera(str(tmp_path / "l515.json"))
    assert find_frames(tmp_path, FrameOptions(camera))[0].read().units_per_metre == UNITS


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (FrameOptions(IN_FILE, 9.0), DepthUnits(9.0, 9.0, is_stated=True)),
        (FrameOptions(IN_FILE), DepthUnits(UNITS, 1.0, UNITS)),
        (FrameOptions(CameraFile(*build.FOUR)), DepthUnits(7.0, 1.0, 7.0)),
        (FrameOptions(), DepthUnits(7.0, 1.0, 7.0)),
    ],
)
def test_a_stated_unit_wins_over_the_unit_in_a_file(
    options: FrameOptions, expected: DepthUnits
) -> None:
    assert options.depth_units(7.0, 5.0) == expected


def test_without_a_stated_unit_the_layouts_unit_is_taken() -> None:
    assert FrameOptions().depth_units(usual=5.0).integers == 5.0
    assert FrameOptions().depth_units() == DepthUnits()


def test_arrays_may_state_their_unit_and_lens(tmp_path: Path) -> None:
    facts = {"K": build.K.ravel(), "depth_scale": 1 / UNITS, "D": [0.1, 0.0, 0.0, 0.0]}
    np.savez(tmp_path / "x.npz", depth=build.depth(0), rgb=build.color(0), **facts)
    frame = find_frames(tmp_path)[0].read()
    assert frame.units_per_metre == UNITS
    assert frame.removed is not None
    stated = find_frames(tmp_path, FrameOptions(depth_units_per_metre=1000.0))[0].read()
    assert stated.units_per_metre == 1000.0


def test_the_scale_of_an_object_in_arrays_is_no_unit(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", depth=build.depth(0), K=build.K, scale=2.0)
    assert find_frames(tmp_path)[0].read().units_per_metre == 1000.0


def test_transforms_json_may_state_the_unit_but_its_scale_is_the_scenes(tmp_path: Path) -> None:
    build.nerfstudio(tmp_path)
    index = tmp_path / "transforms.json"
    content = json.loads(index.read_text())
    index.write_text(json.dumps(content | {"scale": 0.5}))
    assert find_frames(tmp_path)[0].read().units_per_metre == 1000.0
    index.write_text(json.dumps(content | {"integer_depth_scale": 1 / UNITS}))
    assert find_frames(tmp_path)[0].read().units_per_metre == UNITS


def test_a_stated_camera_replaces_a_file_without_one_and_keeps_its_unit(tmp_path: Path) -> None:
    build.pair(tmp_path / "x_color.png", tmp_path / "x_depth.png", 0)
    two = {"color": {"fx": 60.0}, "depth": {"fx": 61.0}, "depth_scale": 1 / UNITS}
    (tmp_path / "intrinsics.json").write_text(json.dumps(two))
    options = FrameOptions(CameraFile(*build.FOUR))
    assert find_frames(tmp_path, options)[0].read().units_per_metre == UNITS


def scaled(folder: Path, name: str, content: str) -> Path:
    """A frame in a folder with a file that states the unit of the depth."""
    build.pair(folder / "0_color.png", folder / "0_depth.png", 0, 4000)
    (folder / "camera.json").write_text(
        json.dumps(dict(zip(("fx", "fy", "cx", "cy"), build.FOUR, strict=True)))
    )
    if name.endswith(".npy"):
        np.save(folder / name, float(content))
    else:
        (folder / name).write_text(content)
    return folder


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("depth_scale.txt", "0.00025\n"),
        ("camera_depth_scale.txt", "2.500000000000000000e-04"),
        ("depth_scale.npy", "0.00025"),
        ("depth_units.txt", "4000"),
        ("depth_scale.txt", "depth_scale = 0.00025"),
    ],
)
def test_a_file_with_the_scale_of_the_depth_alone_counts(
    tmp_path: Path, name: str, content: str
) -> None:
    (source,) = find_frames(scaled(tmp_path, name, content))
    assert source.read().units_per_metre == 4000.0
    assert tmp_path / name in source.files  # so that results are made again if it changes
    stated = FrameOptions(depth_units_per_metre=2000.0)
    assert find_frames(tmp_path, stated)[0].read().units_per_metre == 2000.0
    camera = json.loads((tmp_path / "camera.json").read_text())
    (tmp_path / "camera.json").write_text(json.dumps(camera | {"depth_scale": 5000}))
    assert find_frames(tmp_path)[0].read().units_per_metre == 5000.0


@pytest.mark.parametrize("content", ["1.01", "many", "", "nan", "0", "0.001 0.002"])
def test_a_scale_that_is_no_unit_is_refused(tmp_path: Path, content: str) -> None:
    folder = scaled(tmp_path, "depth_scale.txt", content)
    with pytest.raises(FormatError, match=r"depth_scale\.txt: states the unit.*--depth-units-per"):
        find_frames(folder)[0].read()
    assert find_frames(folder, FrameOptions(None, 4000.0))[0].read().units_per_metre == 4000.0


@pytest.mark.parametrize(
    ("name", "content", "units"),
    [
        ("depth_scale.txt", "0.001", 1000.0),
        ("depth_units.txt", "m", 1.0),
        ("depth_units.txt", "mm", 1000.0),
        ("depth_units.txt", "cm", 100.0),
        ("note.txt", "", 1.0),
    ],
)
@pytest.mark.parametrize("suffix", [".npy", ".npz", ".tif"])
def test_floats_too_large_for_metres_have_the_unit_of_whole_numbers_if_it_is_written(
    tmp_path: Path, name: str, content: str, units: float, suffix: str
) -> None:
    folder = scaled(tmp_path, name, content)
    (tmp_path / "0_depth.png").unlink()
    stored = np.float32(build.depth(0) * units / 1000.0)
    save = {".npy": np.save, ".npz": np.savez, ".tif": lambda path, d: cv2.imwrite(str(path), d)}
    save[suffix](folder / f"0_depth{suffix}", stored)
    frame = find_frames(folder)[0].read()
    assert (frame.units_per_metre, frame.depth.max()) == (units, pytest.approx(0.899))


def test_floats_too_large_for_metres_are_refused_without_a_unit(tmp_path: Path) -> None:
    folder = scaled(tmp_path, "note.txt", "")
    (tmp_path / "0_depth.png").unlink()
    np.save(folder / "0_depth.npy", np.float32(build.depth(0)))
    with pytest.raises(FormatError, match="give the units per metre"):
        find_frames(folder)[0].read()
