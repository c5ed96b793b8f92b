"""isaac_grasp files."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from pipelines.grasp_files.exports import isaac_grasps
from pipelines.grasp_files.exports.export_poses import ExportGripper
from pipelines.grasp_files.exports.grasp_exports import FrameGrasps
from pipelines.grasp_files.gripper_files import load_gripper
from tests.grasp_files.exports.export_readers import yaml_content
from tests.grasp_files.exports.gripper_toys import random_frame, random_result


def test_frankas_finger_joint_is_half_the_distance(tmp_path):
    _, header = random_frame(np.random.default_rng(0), 0)
    gripper = load_gripper("franka")
    exported = ExportGripper(gripper, gripper.base_to_contacts, "franka")
    frame = FrameGrasps.of(random_result(np.random.default_rng(0), 9, "x"), 0, exported)
    isaac_grasps.write_frame(tmp_path / "x.yaml", frame, replace(header, gripper=exported))
    found = yaml_content(tmp_path / "x.yaml")["grasps"]
    assert len(found) == len(frame) > 2
    for grasp, width in zip(found.values(), frame.grasps.width, strict=True):
        joint = "panda_finger_joint1"
        assert_allclose(grasp["cspace_position"][joint], width / 2, atol=1e-9)
        open_ = width / 2 + gripper.clearance
        assert_allclose(grasp["pregrasp_cspace_position"][joint], open_, atol=1e-9)
        assert grasp["pregrasp_cspace_position"][joint] <= 0.04


def test_a_frame_without_grasps_is_an_empty_mapping(tmp_path):
    frame, header = random_frame(np.random.default_rng(0), 0, name="x")
    isaac_grasps.write_frame(tmp_path / "x.yaml", frame, header)
    assert yaml_content(tmp_path / "x.yaml")["grasps"] == {}


def test_small_numbers_are_read_as_numbers_and_not_as_text(tmp_path):
    frame, header = random_frame(np.random.default_rng(0), 2, name="x")
    moved = replace(frame.grasps, translation=frame.grasps.translation * 1e-7)
    isaac_grasps.write_frame(tmp_path / "x.yaml", replace(frame, grasps=moved), header)
    assert "e-" not in (tmp_path / "x.yaml").read_text().split("grasps:")[1]
