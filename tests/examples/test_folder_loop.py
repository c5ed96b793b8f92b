"""The loop over a folder: a file of poses for each frame."""

import json

import numpy as np

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
    folder_loop.main([str(frames), "--out", str(out), "--gripper", "franka"])
    assert [path.name for path in out.iterdir()] == ["a.json"]
    written = json.loads((out / "a.json").read_text(encoding="utf-8"))
    assert written["gripper"] == "franka"
    poses = np.array(written["poses"])
    assert len(poses) == len(written["openings"]) == len(written["rank_scores"]) > 0
    np.testing.assert_allclose(nearest_orthogonal(poses[:, :3, :3]), poses[:, :3, :3], atol=1e-5)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["a", "b", "c"]
