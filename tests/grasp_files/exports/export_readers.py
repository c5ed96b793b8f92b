"""Readers of exported files, by the formulas of the tools that use each format.

Every reader gives the contacts (n, 2, 3) of a frame's grasps in the order of the file.
"""

import csv
import json
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from pipelines.grasping.gripper import Gripper


def pair(middle, closing, width):
    half = 0.5 * np.asarray(width)[:, None] * closing
    return np.stack([middle - half, middle + half], 1)


def linked(positions, xyzw, widths, base_to_contacts):
    """Contacts from the pose of a gripper's link: z = approach, y = closing."""
    if not len(widths):
        return np.zeros((0, 2, 3))
    R = Rotation.from_quat(xyzw).as_matrix()
    middle = np.asarray(positions) + base_to_contacts * R[:, :, 2]
    return pair(middle, R[:, :, 1], widths)


def graspnet(path: Path, gripper: Gripper):
    """graspnetAPI: the finger tips reach the translation and `depth` along the first column."""
    rows = np.load(path, allow_pickle=False)
    R = rows[:, 4:13].reshape(-1, 3, 3)
    tips = rows[:, 13:16] + rows[:, 3:4] * R[:, :, 0]
    middle = tips - gripper.tip_reach * R[:, :, 0]
    return pair(middle, R[:, :, 1], rows[:, 1] - 2.0 * gripper.clearance)


def contact_graspnet(path: Path, _gripper: Gripper):
    """Contact-GraspNet: translation = contact + width / 2 x - base z."""
    with np.load(path, allow_pickle=False) as arrays:
        base = float(arrays["base_to_contacts"])
        segments = [name.split("/")[1] for name in arrays.files if name.startswith("scores/")]
        parts = [np.zeros((0, 2, 3))]
        for segment in segments:
            poses, first = arrays[f"pred_grasps_cam/{segment}"], arrays[f"contact_pts/{segment}"]
            x, z = poses[:, :3, 0], poses[:, :3, 2]
            half = np.einsum("ni,ni->n", poses[:, :3, 3] + base * z - first, x)
            parts.append(np.stack([first, first + 2.0 * half[:, None] * x], 1))
    return np.concatenate(parts)


def yaml_content(path: Path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def isaac(path: Path, _gripper: Gripper):
    content = yaml_content(path)
    assert content["format"] == "isaac_grasp"
    assert content["format_version"] == 1.0
    found = list(content["grasps"].values())
    turns = [(*each["orientation"]["xyz"], each["orientation"]["w"]) for each in found]
    positions, widths = ([e[k] for e in found] for k in ("position", "contact_width"))
    return linked(positions, turns, widths, content["gripper"]["base_to_contacts"])


def ros_json(path: Path, _gripper: Gripper):
    content = json.loads(path.read_text(encoding="utf-8"))
    poses = content["pose_array"]["poses"]
    positions = [[pose["position"][axis] for axis in "xyz"] for pose in poses]
    turns = [[pose["orientation"][axis] for axis in "xyzw"] for pose in poses]
    return linked(positions, turns, content["widths"], content["gripper"]["base_to_contacts"])


def whole_json(path: Path, name: str):
    content = json.loads(path.read_text(encoding="utf-8"))
    (frame,) = (each for each in content["frames"] if each["name"] == name)
    poses = np.array([each["pose"] for each in frame["grasps"]]).reshape(-1, 4, 4)
    middle = poses[:, :3, 3] + content["gripper"]["base_to_contacts"] * poses[:, :3, 2]
    return pair(middle, poses[:, :3, 1], np.array([g["width"] for g in frame["grasps"]]))


def csv_rows(path: Path):
    lines = path.read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def csv_facts(path: Path):
    lines = path.read_text(encoding="utf-8").splitlines()
    return dict(line[2:].split(": ", 1) for line in lines if line.startswith("# "))


def whole_csv(path: Path, name: str):
    rows = [row for row in csv_rows(path) if row["frame"] == name]
    base = json.loads(csv_facts(path)["gripper"])["base_to_contacts"]

    def columns(*names):
        return np.array([[float(row[each]) for each in names] for row in rows])

    turns = columns(*(f"pose_q{axis}" for axis in "xyzw"))
    widths = columns("width").reshape(-1)
    return linked(columns(*(f"pose_{axis}" for axis in "xyz")), turns, widths, base)
