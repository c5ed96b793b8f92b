"""Grasps as JSON with the field names of ROS messages: OUT/NAME.json, one file per frame.

`pose_array` is a geometry_msgs/PoseArray of gripper poses; the other lists have the same order.
"""

import re
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from pipelines.array_types import Array
from pipelines.grasp_files.exports.grasp_exports import ExportHeader, FrameGrasps, rounded
from pipelines.storage.files import write_json

FORMAT_VERSION = 2
# Unix times of 2001 or later in frames' names: seconds with decimals (TUM), milli-, micro- or
# nanoseconds (bags), after zeros.
SECONDS = re.compile(r"(?<!\d)0*([1-9]\d{9})\.(\d{1,9})(?!\d)")
LATEST = 2**31 - 1  # seconds of a builtin_interfaces/Time, an int32; larger numbers are no time
WHOLE = re.compile(r"(?<!\d)0*([1-9]\d{12}|[1-9]\d{15}|[1-9]\d{18})(?!\d)")


def write_frame(path: Path, frame: FrameGrasps, header: ExportHeader) -> None:
    """Write the file of a frame, NAME.json."""
    table = frame.result.grasps
    content = {
        "format": "symgrasp-ros",
        "format_version": FORMAT_VERSION,
        "units": "metres",
        "axes": header.frame.axes,
        "poses": header.gripper.words,
        "gripper": header.gripper.facts(),
        "frame": frame.result.name,
        "pose_array": {
            "header": {"stamp": time_of(frame.result.name), "frame_id": header.frame.frame_id},
            "poses": _poses(frame),
        },
        "widths": rounded(frame.grasps.width),
        "openings": rounded(frame.opening),
        "scores": rounded(table.rank_score),
        "regions": table.region.tolist(),
        "instances": frame.instances.tolist(),
        "is_best": table.is_best.tolist(),
        "worth_trying": table.worth_trying.tolist(),
        "provenance": header.stamp,
    }
    write_json(path, content)


def time_of(name: str) -> dict[str, int]:
    """Return the time in the frame's name, as frames of bags and of TUM have it, else 0."""
    last = PurePosixPath(name).name
    sec = nanosec = 0
    if found := SECONDS.search(last):
        sec, nanosec = int(found[1]), int(found[2].ljust(9, "0"))
    elif found := WHOLE.search(last):
        sec, nanosec = divmod(int(found[1].ljust(19, "0")), 10**9)
    if sec > LATEST:
        sec = nanosec = 0
    return {"sec": sec, "nanosec": nanosec}


def _poses(frame: FrameGrasps) -> list[dict[str, Any]]:
    positions, (w, x, y, z) = frame.poses[:, :3, 3], frame.quaternions.T
    turns = np.stack([x, y, z, w], 1)
    return [
        {"position": _named(position), "orientation": _named(turn)}
        for position, turn in zip(positions, turns, strict=True)
    ]


def _named(values: Array) -> dict[str, float]:
    return dict(zip("xyzw", rounded(values), strict=False))
