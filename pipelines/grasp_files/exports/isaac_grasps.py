"""isaac_grasp files for Isaac Sim and Isaac ROS: OUT/NAME.yaml, one file per frame.

Poses are relative to the camera or the robot's base instead of the object, because the object's
pose is unknown.
"""

import json
from collections.abc import Iterator
from pathlib import Path

from pipelines.array_types import Array
from pipelines.grasp_files.exports.grasp_exports import ExportHeader, FrameGrasps
from pipelines.storage.files import write_text

# Joints with half the distance of the fingers as position. Other grippers' files name no joint.
FINGER_JOINTS = {"franka": "panda_finger_joint1"}


def write_frame(path: Path, frame: FrameGrasps, header: ExportHeader) -> None:
    """Write the file of a frame, NAME.yaml."""
    lines = [*_head(header), *(_grasps(frame) if len(frame) else ["grasps: {}"])]
    write_text(path, "\n".join(lines) + "\n")


def _head(header: ExportHeader) -> list[str]:
    axes, gripper = json.dumps(header.frame.axes), json.dumps(header.gripper.words)
    return [
        "format: isaac_grasp",
        "format_version: 1.0",
        *(f"object_frame{end}: {axes}" for end in ("", "_link")),
        *(f"gripper_frame{end}: {gripper}" for end in ("", "_link")),
        "units: metres",
        f"gripper: {json.dumps(header.gripper.facts())}",
        f"provenance: {json.dumps(header.stamp)}",
    ]


def _grasps(frame: FrameGrasps) -> Iterator[str]:
    joint = FINGER_JOINTS.get(frame.gripper.model.name)
    table, width, opening = frame.result.grasps, frame.grasps.width, frame.opening
    rank, worth, instances = table.rank_score, table.worth_trying, frame.instances
    positions, quaternions = frame.poses[:, :3, 3], frame.quaternions
    yield "grasps:"
    for i in range(len(frame)):
        yield f"  grasp_{i}:"
        yield f"    confidence: {rank[i]:.6f}"
        yield f"    position: {_row(positions[i])}"
        yield f"    orientation: {{w: {quaternions[i, 0]:.9f}, xyz: {_row(quaternions[i, 1:])}}}"
        if joint is not None:
            yield f"    cspace_position: {{{joint}: {width[i] / 2:.9f}}}"
            yield f"    pregrasp_cspace_position: {{{joint}: {opening[i] / 2:.9f}}}"
        yield f"    worth_trying: {str(bool(worth[i])).lower()}"
        yield f"    contact_width: {width[i]:.9f}"
        yield f"    opening: {opening[i]:.9f}"
        yield f"    instance: {instances[i]}"


def _row(values: Array) -> str:
    # No exponents: YAML 1.1 reads 1e-05 as text.
    return "[" + ", ".join(f"{value:.9f}" for value in values) + "]"
