"""The remark on frames below a folder with frames."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from pipelines.configs import InspectConfig
from pipelines.frames import deeper_frames
from pipelines.frames.deeper_frames import warn_of_deeper_frames
from pipelines.frames.frames import find_frames
from pipelines.inspect_frames import run
from tests.frames.layouts import build

Save = Callable[..., None]


def warnings(folder: Path, caplog: pytest.LogCaptureFixture) -> str:
    warn_of_deeper_frames(folder, find_frames(folder))
    return caplog.text


def test_unread_frames_in_deeper_folders_are_named(
    flat: Path, save: Save, caplog: pytest.LogCaptureFixture
) -> None:
    for place in ("one", "two/further"):
        save(*(flat / place / name for name in ("color.png", "depth.png", "camera.json")))
    assert len(run(flat, InspectConfig()).report.done) == 2
    assert f"the frames in {flat / 'one'}, {flat / 'two/further'} are not read" in caplog.text
    caplog.clear()
    assert warnings(flat / "a_color.png", caplog) == ""


def test_folders_of_the_frames_themselves_and_of_pictures_get_no_remark(
    tmp_path: Path, save: Save, caplog: pytest.LogCaptureFixture
) -> None:
    for scene in ("one", "two"):
        folder = tmp_path / scene
        save(folder / "rgb" / "0.png", folder / "depth" / "0.png", folder / "camera.json")
        save(folder / "label" / "0.png", None, None)
        save(folder / ".trash" / "color.png", folder / ".trash" / "depth.png", None)
    assert warnings(tmp_path, caplog) == ""


def test_clouds_of_the_frames_themselves_get_no_remark(
    tmp_path: Path, save: Save, caplog: pytest.LogCaptureFixture
) -> None:
    save(tmp_path / "rgb" / "0.png", tmp_path / "depth" / "0.png", tmp_path / "camera.json")
    (tmp_path / "pcd").mkdir()
    build.pcd(tmp_path / "pcd")  # as in OCID; the clouds 0, 1 and 2
    assert "pcd are not read" in warnings(tmp_path, caplog)
    caplog.clear()
    for other in (1, 2):
        (tmp_path / f"pcd/{other}.pcd").unlink()
    assert warnings(tmp_path, caplog) == ""


def test_nothing_is_searched_outside_of_the_given_folder(
    tmp_path: Path, save: Save, caplog: pytest.LogCaptureFixture
) -> None:
    for place in ("images", "images/other"):
        save(*(tmp_path / place / name for name in ("color.png", "depth.png", "camera.json")))
    frames = tmp_path / "frames"
    frames.mkdir()
    images = {"file_path": "../images/color.png"}
    images["depth_file_path"] = str(tmp_path / "images" / "depth.png")
    camera = {"fl_x": 60, "fl_y": 61, "cx": 31.5, "cy": 23.5, "w": 64, "h": 48}
    (frames / "transforms.json").write_text(json.dumps(camera | {"frames": [images]}))
    assert find_frames(frames)[0].read().depth.any()
    assert warnings(frames, caplog) == ""


def test_the_search_for_the_remark_is_bounded(
    flat: Path, save: Save, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(deeper_frames, "MOST_FOLDERS", 2)
    for place in ("a", "b", "c"):
        (flat / place).mkdir()
    save(*(flat / "c" / name for name in ("color.png", "depth.png", "camera.json")))
    assert warnings(flat, caplog) == ""
