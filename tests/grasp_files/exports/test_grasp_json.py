"""Grasps as one JSON text."""

import json
from dataclasses import replace

import numpy as np

from pipelines.grasp_files.exports import grasp_json
from pipelines.grasp_files.grasps_tables import GraspTable
from tests.grasp_files.exports.gripper_toys import random_frame


def test_frames_without_grasps_state_the_reason(tmp_path):
    rng = np.random.default_rng(0)
    full, header = random_frame(rng, 2, name="ü")
    bare, _ = random_frame(rng, 0, name="b")
    bare = replace(bare, result=replace(bare.result, message="nothing stands on the table"))
    grasp_json.write(tmp_path / "x.json", [full, bare, full], header)
    frames = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))["frames"]
    assert [len(frame["grasps"]) for frame in frames] == [2, 0, 2]
    assert frames[0]["name"] == "ü"
    assert (frames[1]["status"], frames[1]["message"]) == ("empty", "nothing stands on the table")


def test_a_file_without_frames_is_valid_json(tmp_path):
    _, header = random_frame(np.random.default_rng(0), 0)
    grasp_json.write(tmp_path / "x.json", [], header)
    assert json.loads((tmp_path / "x.json").read_text())["frames"] == []


def test_values_that_were_not_predicted_are_null(tmp_path):
    frame, header = random_frame(np.random.default_rng(0), 1)
    table = frame.result.grasps
    columns = {name: getattr(table, name) for name in GraspTable.SPEC}
    table = GraspTable(**columns | {"affordance": np.full(1, np.nan)})
    frame = replace(frame, result=replace(frame.result, grasps=table))
    grasp_json.write(tmp_path / "x.json", [frame], header)
    (found,) = json.loads((tmp_path / "x.json").read_text())["frames"][0]["grasps"]
    assert found["affordance"] is None
