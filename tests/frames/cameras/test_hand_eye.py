"""Hand-eye calibrations in the files of the usual tools."""

import json
import math

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.cameras.hand_eye import find_frame_pose, read_hand_eye
from pipelines.geometry.transforms import make_pose, matrix_to_quaternion, random_rotation

T_BASE_CAM = make_pose(random_rotation(np.random.default_rng(3)), [0.5, -0.2, 0.8])
W, X, Y, Z = matrix_to_quaternion(T_BASE_CAM[:3, :3]).tolist()
ROWS = T_BASE_CAM.tolist()
EASY_HANDEYE = f"""
parameters:
  eye_on_hand: false
  freehand_robot_movement: true
  robot_base_frame: base_link
  robot_effector_frame: tool0
  tracking_base_frame: camera_color_optical_frame
transformation: {{qw: {W}, qx: {X}, qy: {Y}, qz: {Z}, x: 0.5, y: -0.2, z: 0.8}}
"""
EASY_HANDEYE2 = f"""
parameters:
  name: cell
  calibration_type: eye_on_base
  robot_base_frame: base_link
  tracking_base_frame: camera_color_optical_frame
transform:
  translation: {{x: 0.5, y: -0.2, z: 0.8}}
  rotation: {{x: {X}, y: {Y}, z: {Z}, w: {W}}}
"""
LAUNCH = f"""<launch>
  <!-- xyz="0.5 -0.2 0.8" -->
  <node pkg="tf2_ros" type="static_transform_publisher" name="camera_link_broadcaster"
      args="0.5 -0.2 0.8   {X} {Y} {Z} {W} base_link camera_color_optical_frame" />
</launch>
"""
FILES = {
    "bare.json": json.dumps(ROWS),
    "flat.json": json.dumps(T_BASE_CAM.ravel().tolist()),
    "named.json": json.dumps({"T_base_cam": ROWS, "rms": 0.4}),
    "savetxt.txt": "\n".join(" ".join(map(repr, row)) for row in ROWS),
    "commas.txt": "\n".join(", ".join(map(repr, row)) for row in ROWS),
    "matrix.yaml": f"camera_to_base: {ROWS}\n",
    "bare.yaml": f"{ROWS}\n",
    "rows.yaml": "".join(f"- {row}\n" for row in ROWS),
    "flat.yml": f"---\n{T_BASE_CAM.ravel().tolist()}\n---\n",
    "dumped.yaml": yaml.safe_dump(ROWS),
    "lists.yaml": f"position: [0.5, -0.2, 0.8]\norientation: [{X}, {Y}, {Z}, {W}]\n",
    "both.json": json.dumps(
        {
            "translation": T_BASE_CAM[:3, 3].tolist(),
            "rotation": T_BASE_CAM[:3, :3].tolist(),
            "quaternion": [X, Y, Z, W],
        }
    ),
    "three_rows.json": json.dumps({"T_base_cam": ROWS[:3]}),
    "three_rows.txt": "\n".join(" ".join(map(repr, row)) for row in ROWS[:3]),
    "rotation.yaml": f"rotation: {[row[:3] for row in ROWS[:3]]}\ntranslation: [0.5, -0.2, 0.8]\n",
    "columns.json": json.dumps(
        {
            "rotation_matrix": T_BASE_CAM[:3, :3].ravel().tolist(),
            "translation": [[0.5], [-0.2], [0.8]],
            "P": (600 * np.eye(3, 4)).tolist(),
        }
    ),
    "easy_handeye.yaml": EASY_HANDEYE,
    "easy_handeye2.calib": EASY_HANDEYE2,
    "moveit.launch": LAUNCH,
    "twice.json": json.dumps({"T": ROWS, "rounded": T_BASE_CAM.round(4).tolist()}),
    "lens.json": json.dumps({"K": (600 * np.eye(4)).tolist(), "base_to_gripper_cam": ROWS}),
    "commented.launch": f'<!-- args="0.7 -0.2 0.8 {X} {Y} {Z} {W} base_link camera" -->\n{LAUNCH}',
    "fixed.json": json.dumps({"eye_in_hand": False, "type": "eye_to_hand", "T": ROWS}),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("name", FILES)
def test_the_pose_is_read_from_the_file_of_every_tool(name, encoding, tmp_path):
    (tmp_path / name).write_text(FILES[name], encoding=encoding)
    found = read_hand_eye(tmp_path / name)
    assert_allclose(found.T_base_cam, T_BASE_CAM, atol=1e-9)
    if "robot_base_frame" in FILES[name] or name.endswith(".launch"):
        assert found.base == "base_link"


@pytest.mark.parametrize("camera", ["camera_link", "cell/camera_color_frame", "optical_frame"])
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("easy_handeye.yaml", EASY_HANDEYE),
        ("easy_handeye2.calib", EASY_HANDEYE2),
        ("moveit.launch", LAUNCH),
        ("period.launch", LAUNCH.replace("_frame", "_frame 100")),
        (
            "transform.json",
            json.dumps(
                {
                    "header": {"frame_id": "base_link"},
                    "child_frame_id": "camera_color_optical_frame",
                    "transform": {"translation": [0.5, -0.2, 0.8], "rotation": [X, Y, Z, W]},
                }
            ),
        ),
    ],
)
def test_a_frame_of_the_cameras_body_is_told_from_the_optical_frame(camera, name, text, tmp_path):
    (tmp_path / name).write_text(text.replace("camera_color_optical_frame", camera))
    found = read_hand_eye(tmp_path / name)
    assert found.camera == camera
    assert found.is_of_body == (camera != "optical_frame")


def test_a_matrix_alone_names_no_camera(tmp_path):
    (tmp_path / "x.json").write_text(json.dumps(ROWS))
    assert read_hand_eye(tmp_path / "x.json").camera == ""
    assert not read_hand_eye(tmp_path / "x.json").is_of_body


def test_the_pose_is_read_from_an_array_that_numpy_saved(tmp_path):
    np.save(tmp_path / "x.npy", T_BASE_CAM)
    assert_allclose(read_hand_eye(tmp_path / "x.npy").T_base_cam, T_BASE_CAM, atol=1e-9)
    np.save(tmp_path / "x.npy", T_BASE_CAM[:3])
    assert_allclose(read_hand_eye(tmp_path / "x.npy").T_base_cam, T_BASE_CAM, atol=1e-9)
    np.save(tmp_path / "x.npy", T_BASE_CAM[:3, :3])
    with pytest.raises(FormatError, match="holds no pose"):
        read_hand_eye(tmp_path / "x.npy")


@pytest.mark.parametrize(
    "arrays",
    [
        {"T_base_cam": T_BASE_CAM, "K": np.diag([600.0, 600.0, 1.0]), "rms": 0.4},
        {"rotation": T_BASE_CAM[:3, :3], "translation": T_BASE_CAM[:3, 3:]},
    ],
)
def test_the_pose_is_read_from_named_arrays_that_numpy_saved(tmp_path, arrays):
    np.savez(tmp_path / "x.npz", **arrays)
    assert_allclose(read_hand_eye(tmp_path / "x.npz").T_base_cam, T_BASE_CAM, atol=1e-9)


def test_the_facts_next_to_the_pose_are_read_from_named_arrays_too(tmp_path):
    np.savez(tmp_path / "x.npz", T=T_BASE_CAM, child_frame_id="camera_link")
    assert read_hand_eye(tmp_path / "x.npz").is_of_body
    np.savez(tmp_path / "x.npz", T=T_BASE_CAM, eye_in_hand=True)
    with pytest.raises(FormatError, match="camera on the hand"):
        read_hand_eye(tmp_path / "x.npz")


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("a.yaml", EASY_HANDEYE.replace("false", "true", 1), "camera on the hand"),
        ("b.yaml", EASY_HANDEYE2.replace("eye_on_base", "eye_in_hand"), "camera on the hand"),
        ("c.json", json.dumps({"fx": 600}), "holds no pose of a camera"),
        ("d.json", json.dumps((2 * T_BASE_CAM).tolist()), "no rotation and translation"),
        ("e.json", json.dumps((T_BASE_CAM + 1e3 * np.eye(4, k=3)).tolist()), "millimetres"),
        ("o.json", json.dumps([[math.nan] * 4] * 4), "no rotation and translation|no number"),
        ("f.yaml", EASY_HANDEYE.replace(f"{W}", "7.5"), "quaternion of length"),
        ("g.json", "null", "holds no pose"),
        ("p.json", json.dumps({"P": (600 * np.eye(3, 4)).tolist()}), "no rotation and translation"),
        (
            "r.json",
            json.dumps({"rotation": (2 * np.eye(3)).tolist(), "translation": [0, 0, 1]}),
            "no rotation and translation",
        ),
        ("h.json", json.dumps([[1, 2], [3]]), "holds no pose"),
        ("i.launch", "<launch/>", "publishes no static transform"),
        ("k.txt", "fx = 600", "does not hold numbers alone"),
        ("l.txt", "1 2 3", "holds no pose"),
        ("m.yaml", "- [1, 0]\n- [0, 1]\n", "holds no pose"),
        ("n.yaml", "", "holds no pose"),
        ("j.yaml", "parameters: 3\ntransformation: [1, 2]\n", "holds no pose"),
    ],
)
def test_a_file_without_a_valid_pose_is_reported_in_one_sentence(name, text, sentence, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match=sentence):
        read_hand_eye(tmp_path / name)


MOVED = make_pose(T_BASE_CAM[:3, :3], [0.1, 0.0, 0.05]).tolist()
TRANSFORM = {
    "header": {"frame_id": "panda_hand"},
    "transform": {"translation": [0.5, -0.2, 0.8], "rotation": [X, Y, Z, W]},
}


@pytest.mark.parametrize(
    ("name", "text", "names"),
    [
        ("a.json", json.dumps({"base2cam": ROWS, "cam2base": MOVED}), "base2cam, cam2base"),
        ("b.json", json.dumps({"T": ROWS, "more": {"T_flange": MOVED}}), r"T, more\.T_flange"),
        ("c.json", json.dumps(TRANSFORM["transform"] | {"T": MOVED, "U": MOVED}), "T, U"),
        ("d.launch", LAUNCH + LAUNCH.replace("0.5", "0.7"), "base_link, base_link"),
    ],
)
def test_of_several_poses_none_is_taken(name, text, names, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match=rf"holds several poses \(.*{names}\)"):
        read_hand_eye(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", json.dumps({"type": "eye_in_hand", "T": ROWS})),
        ("b.json", json.dumps({"info": {"setup": "Eye-in-Hand calibration"}, "T": ROWS})),
        ("c.yaml", f"eye_in_hand: true\nT: {ROWS}\n"),
        ("d.json", json.dumps({"cam2gripper": ROWS})),
        ("e.json", json.dumps({"eye_in_hand": ROWS})),
        ("f.json", json.dumps(TRANSFORM)),
        ("g.launch", LAUNCH.replace("base_link", "panda_hand")),
        ("h.launch", LAUNCH.replace("base_link", "tool0")),
        ("i.launch", LAUNCH.replace("base_link", "end_effector_link")),
    ],
)
def test_a_camera_on_the_hand_is_refused_however_the_file_states_it(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match="camera on the hand"):
        read_hand_eye(tmp_path / name)


def test_a_text_beyond_the_limit_is_refused_and_not_cut(tmp_path):
    path = tmp_path / "long.launch"
    path.write_text(f"<!-- {'x' * 2**16} -->\n{LAUNCH}", encoding="utf-8")
    with pytest.raises(FormatError, match="has more than 65536 bytes"):
        read_hand_eye(path)


@pytest.mark.parametrize("name", ["scene/7", "n" * 300, "null\0byte"])
def test_a_frame_of_any_name_without_a_pose_is_reported(name, tmp_path):
    with pytest.raises(SymgraspError, match="has no camera pose for it"):
        find_frame_pose(tmp_path, name)
