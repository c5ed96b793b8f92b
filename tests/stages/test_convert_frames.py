"""`convert-frames`: any layout to flat pairs, to the last bit; pickles only if trusted."""

import os
import shutil
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from typer.testing import CliRunner

from pipelines import convert_frames
from pipelines.configs import ConvertFramesConfig
from pipelines.errors import StaleOutputError, SymgraspError, ValueRangeError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.storage.provenance import make_stamp, write_sidecar
from symgrasp_cli.app import app
from tests.frames.layouts import build

CONFIG, TRUSTING = ConvertFramesConfig(), ConvertFramesConfig(trust_pickle=True)
METRES = build.depth(0).astype(np.float32) / 1000


@pytest.mark.parametrize("key", build.LAYOUTS)
def test_every_layout_is_the_same_after_conversion(tmp_path: Path, key: str) -> None:
    (tmp_path / "in").mkdir()
    build.LAYOUTS[key][1](tmp_path / "in")
    stated = FrameOptions(CameraFile(*build.FOUR) if key == "tum" else None)
    report = convert_frames.run(tmp_path / "in", tmp_path / "out", CONFIG, stated=stated)
    before = [source.read() for source in find_frames(tmp_path / "in", stated)]
    after = [source.read() for source in find_frames(tmp_path / "out")]
    assert [frame.name for frame in after] == [frame.name for frame in before] == report.done
    for one, other in zip(before, after, strict=True):
        assert_array_equal(one.depth, other.depth)
        assert_array_equal(one.color, other.color)
        assert one.intrinsics == other.intrinsics


@pytest.mark.parametrize("units", [1.0, 0.5, 1000.0])
def test_depth_of_whole_metres_is_the_same_after_conversion(tmp_path: Path, units: float) -> None:
    (tmp_path / "in").mkdir()
    depth = np.where(np.arange(64) < 32, 1.0, 2.0) * np.ones((48, 1))
    stored = (depth * units).astype(np.float32 if units <= 1 else np.uint16)
    np.savez(tmp_path / "in" / "wall.npz", depth=stored, K=build.K)
    stated = FrameOptions(None, units)
    convert_frames.run(tmp_path / "in", tmp_path / "out", CONFIG, stated=stated)
    assert_array_equal(find_frames(tmp_path / "out")[0].read().depth, depth)


@pytest.fixture
def pickled(tmp_path: Path) -> Path:
    content = {"depth": METRES, "K": build.K, "rgb": build.color(0)[:, :, ::-1], "note": "mug"}
    folder = tmp_path / "in"
    folder.mkdir()
    np.save(folder / "mug.npy", content, allow_pickle=True)
    return folder


def test_a_pickle_is_refused_unless_it_is_trusted(pickled: Path, tmp_path: Path) -> None:
    with pytest.raises(SymgraspError, match="--trust-pickle"):
        convert_frames.run(pickled, tmp_path / "out", CONFIG)
    assert not (tmp_path / "out").exists()
    convert_frames.run(pickled / "mug.npy", tmp_path / "out", TRUSTING)
    frame = find_frames(tmp_path / "out")[0].read()
    assert_array_equal(frame.depth, METRES)
    assert_array_equal(frame.color, build.color(0))


class Evil:
    def __reduce__(self) -> Any:
        return os.system, ("touch flag",)


def test_no_code_of_a_trusted_pickle_is_run(
    pickled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save(pickled / "evil.npy", {"depth": METRES, "K": Evil()}, allow_pickle=True)
    report = convert_frames.run(pickled, tmp_path / "out", TRUSTING)
    assert report.done == ["mug"]
    assert "system" in report.failed["evil"]
    assert not (tmp_path / "flag").exists()
    assert not (tmp_path / "out/evil_color.png").exists()


def test_a_second_run_skips_and_other_settings_are_refused(pickled: Path, tmp_path: Path) -> None:
    convert_frames.run(pickled, tmp_path / "out", TRUSTING)
    assert convert_frames.run(pickled, tmp_path / "out", TRUSTING).skipped == ["mug"]
    for lost in list((tmp_path / "out").glob("mug_*")):
        lost.unlink()
        assert convert_frames.run(pickled, tmp_path / "out", TRUSTING).done == ["mug"]
        assert lost.is_file()
    with pytest.raises(StaleOutputError):
        convert_frames.run(pickled, tmp_path / "out", TRUSTING, stated=FrameOptions(None, 0.9))
    (tmp_path / "mine").mkdir()
    write_sidecar(tmp_path / "mine", make_stamp("export", {}))
    for overwrite in (False, True):
        with pytest.raises(SymgraspError, match="no output of convert-frames; choose another"):
            convert_frames.run(pickled, tmp_path / "mine", TRUSTING, overwrite=overwrite)
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["provenance.json"]


def test_a_real_pickle_of_python_2_is_converted_to_the_flat_frame(
    shared: Path, tmp_path: Path
) -> None:
    native = shared / "frames/6dofgraspnet_realsense/native/blue_mug.npy"
    convert_frames.run(native, tmp_path / "out", TRUSTING)
    frame = find_frames(tmp_path / "out")[0].read()
    flat = {s.name: s for s in find_frames(shared / "frames/6dofgraspnet_realsense")}["blue_mug"]
    assert np.abs(frame.depth - flat.read().depth).max() < 6e-4  # stored in whole millimetres
    assert_array_equal(frame.color, flat.read().color)


def test_an_output_that_holds_the_frames_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    build.flat(tmp_path / "in")
    convert_frames.run(tmp_path / "in", tmp_path / "out", CONFIG)
    shutil.move(tmp_path / "in", tmp_path / "out" / "in")
    with pytest.raises(ValueRangeError, match="a folder that does not hold the frames"):
        convert_frames.run(tmp_path / "out" / "in", tmp_path / "out", CONFIG, overwrite=True)
    assert find_frames(tmp_path / "out" / "in")


def test_a_frame_that_failed_is_reported_again_by_a_second_run(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    build.flat(tmp_path / "in")
    build.image(tmp_path / "in" / "1_depth.png", np.zeros_like(build.depth(1)))
    first, second = (convert_frames.run(tmp_path / "in", tmp_path / "out", CONFIG) for _ in "ab")
    assert (first.done, list(first.failed)) == (["0"], ["1"])
    assert (second.skipped, second.exit_code) == (["0"], 1)
    assert second.failed == {"1": f"{first.failed['1']} (--overwrite tries it again)"}


def test_a_file_that_is_lost_after_the_search_fails_its_frame_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    build.flat(tmp_path / "in")
    sources = find_frames(tmp_path / "in")
    (tmp_path / "in" / "1_depth.png").unlink()
    monkeypatch.setattr(convert_frames, "find_frames", Mock(side_effect=[sources, sources[:1]]))
    report = convert_frames.run(tmp_path / "in", tmp_path / "out", CONFIG)
    assert (report.done, list(report.failed)) == (["0"], ["1"])


def test_frames_of_a_plain_and_of_a_named_sensor_are_all_read_back(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    build.bop_scene(tmp_path / "in")
    build.bop_sensor(tmp_path / "in")
    report = convert_frames.run(tmp_path / "in", tmp_path / "out", CONFIG)
    names = ["frames/000000", "frames/000001", "photoneo/000000", "photoneo/000001"]
    assert sorted(report.done) == names
    assert [source.read().name for source in find_frames(tmp_path / "out")] == names
    again = convert_frames.run(tmp_path / "in", tmp_path / "out", CONFIG)
    assert sorted(again.skipped) == names


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["1", "2"], ["1", "2"]),
        (["a/1", "b/c/1"], ["a/1", "b/c/1"]),
        (["a/1", "a/b/1"], ["a/frames/1", "a/b/1"]),
        (["1", "frames/x/1", "frames-2/1"], ["frames-3/1", "frames/x/1", "frames-2/1"]),
    ],
)
def test_no_frame_is_next_to_a_folder_of_frames(names: list[str], expected: list[str]) -> None:
    assert convert_frames.separate_names(names) == expected


def test_a_frame_that_is_not_found_again_counts_as_failed(tmp_path: Path) -> None:
    build.nerfstudio(tmp_path)
    index = tmp_path / "transforms.json"
    text = index.read_text().replace("./images/1.png", ".hidden/0.png")
    index.write_text(text)
    (tmp_path / ".hidden").mkdir()
    (tmp_path / "images/1.png").rename(tmp_path / ".hidden/0.png")
    report = convert_frames.run(tmp_path, tmp_path / "out", CONFIG)
    assert report.done == ["images/0"]
    assert "is not found again under this name" in report.failed[".hidden/0"]


def test_the_command_converts_frames(pickled: Path, tmp_path: Path) -> None:
    arguments = ["convert-frames", str(pickled), "--out", str(tmp_path / "out")]
    refused = CliRunner().invoke(app, arguments)
    assert refused.exit_code == 1
    assert "Traceback" not in refused.output
    assert CliRunner().invoke(app, [*arguments, "--trust-pickle"]).exit_code == 0
