"""Grasps as JSON in the words of ROS messages: OUT/NAME.json, one a frame.

`pose_array` is a geometry_msgs/PoseArray, poses of the gripper's base; lists beside it are in its
order.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.grasp_files.exports.grasp_exports import (
    CAMERA_AXES,
    GRIPPER_AXES,
    ExportHeader,
    FrameGrasps,
    frame_path,
    rounded,
)
from pipelines.storage.files import write_json

FORMAT_VERSION = 1
FRAME_ID = "camera_color_optical_frame"  # REP 103: the axes of OpenCV


def write_frame(folder: Path, frame: FrameGrasps, header: ExportHeader) -> None:
    """Write `folder`/NAME.json of a frame."""
    table = frame.result.grasps
    content = {
        "format": "symgrasp-ros",
        "format_version": FORMAT_VERSION,
        "units": "metres",
        "camera_frame": CAMERA_AXES,
        "poses": f"base of the gripper in the camera frame: {GRIPPER_AXES}",
        "gripper": header.gripper.facts(),
        "frame": frame.result.name,
        "pose_array": {
            "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": FRAME_ID},
            "poses": _poses(frame),
        },
        "widths": rounded(frame.grasps.width),
        "openings": rounded(frame.opening),
        "scores": rounded(table.rank_score),
        "regions": table.region.tolist(),
        "is_best": table.is_best.tolist(),
        "provenance": header.stamp,
    }
    write_json(frame_path(folder, frame.result.name, ".json"), content)


def _poses(frame: FrameGrasps) -> list[dict[str, Any]]:
    positions, (w, x, y, z) = frame.poses[:, :3, 3], frame.quaternions.T
    turns = np.stack([x, y, z, w], 1)
    return [
        {"position": _named(position), "orientation": _named(turn)}
        for position, turn in zip(positions, turns, strict=True)
    ]


def _named(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip("xyzw", rounded(values), strict=False))
