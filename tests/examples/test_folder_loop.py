"""The loop over a folder: a file of poses for each frame."""

import json

import numpy as np
import pytest

from examples import folder_loop
from pipelines.geometry.transforms import nearest_orthogonal
from pipelines.storage.files import write_json
from pipelines.storage.images import write_image
from tests.examples.tabletop_frame import COLOR, DEPTH, LENS, light_detector


def test_each_frame_has_its_poses_and_a_damaged_frame_is_passed_over(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(folder_loop, "GraspDetector", light_detector)
    frames, out = tmp_path / "frames", tmp_path / "out"
    for name in "abc":
        write_image(frames / f"{name}_color.png", COLOR)
        write_image(frames / f"{name}_depth.png", np.round(DEPTH * 10000).astype(np.uint16))
        camera = dict(zip(("fx", "fy", "cx", "cy"), LENS, strict=True))
        write_json(frames / f"{name}_camera.json", camera | {"depth_scale": 10000})
    (frames / "b_depth.png").write_bytes(b"torn")
    (frames / "c_camera.json").unlink()
    with pytest.raises(SystemExit, match="1"):
        folder_loop.main([str(frames), "--out", str(out), "--gripper", "franka"])
    assert [path.name for path in out.iterdir()] == ["a.json"]
    written = json.loads((out / "a.json").read_text(encoding="utf-8"))
    assert written["gripper"] == "franka"
    poses = np.array(written["poses"])
    assert len(poses) == len(written["openings"]) == len(written["rank_scores"]) > 0
    assert written["worth_trying"] == [True] * len(poses)
    np.testing.assert_allclose(nearest_orthogonal(poses[:, :3, :3]), poses[:, :3, :3], atol=1e-5)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["a", "b", "c"]


def test_a_folder_without_frames_is_reported(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        folder_loop.main([str(tmp_path / "typo"), "--out", str(tmp_path / "out")])
    assert capsys.readouterr().err.endswith("typo holds no NAME_color.png\n")
    assert not (tmp_path / "out").exists()


def test_a_frame_without_its_own_camera_has_that_of_all_frames(tmp_path, monkeypatch):
    monkeypatch.setattr(folder_loop, "GraspDetector", light_detector)
    camera = dict(zip(("fx", "fy", "cx", "cy"), LENS, strict=True))
    for name in "ab":
        write_image(tmp_path / f"{name}_color.png", COLOR)
        write_image(tmp_path / f"{name}_depth.png", np.round(DEPTH * 1000).astype(np.uint16))
    write_json(tmp_path / "camera.json", camera)
    write_json(tmp_path / "b_camera.json", camera | {"cx": camera["cx"] + 5.0})
    folder_loop.main([str(tmp_path), "--out", str(tmp_path)])
    of_all, own = (json.loads((tmp_path / f"{name}.json").read_text())["poses"] for name in "ab")
    assert of_all
    assert own
    assert of_all[0] != own[0]
