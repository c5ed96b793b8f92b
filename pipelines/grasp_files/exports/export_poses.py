"""Origin and frame of exported poses: gripper base or tool point, in camera or robot frame."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.array_types import Array
from pipelines.errors import ValueRangeError
from pipelines.frames.cameras.hand_eye import HandEye, find_frame_pose, read_hand_eye
from pipelines.frames.frame_names import shared_last_parts
from pipelines.grasping.gripper import Gripper

log = logging.getLogger(__name__)
CAMERA_AXES = "camera, OpenCV axes: x right, y down, z forward"
CAMERA_FRAME, BASE_FRAME = "camera_color_optical_frame", "base_link"  # REP 103, REP 105
GRIPPER_AXES = "y = closing, from the first contact to the second; z = approach; x = y cross z"
LONGEST_TOOL = 1.0  # metres from a mounting face to a tool centre point


@dataclass(frozen=True)
class ExportGripper:
    """The gripper of exported poses.

    Attributes:
        model: measures of the gripper.
        base_to_contacts: metres along approach, from the poses' origin to the contact line.
        checked_with: name of the gripper that `infer` checked collisions with.
        is_the_one_checked: whether that gripper has the same measures.
        origin: the origin of the poses, in words.
    """

    model: Gripper
    base_to_contacts: float
    checked_with: str
    is_the_one_checked: bool = True
    origin: str = "base"

    @property
    def words(self) -> str:
        """Origin and axes of the poses, in words."""
        return f"{self.origin} of {self.model.name}: {GRIPPER_AXES}"

    def facts(self) -> dict[str, Any]:
        """Return the entries of a file on the gripper, metres."""
        return {
            "name": self.model.name,
            "origin": self.origin,
            "base_to_contacts": round(self.base_to_contacts, 9),
            "tip_reach": self.model.tip_reach,
            "max_opening": self.model.max_opening,
            "clearance": self.model.clearance,
            "collisions_checked_with": self.checked_with,
        }


@dataclass(frozen=True)
class PoseFrame:
    """The frame of exported poses.

    Attributes:
        T_frame_cam: (4, 4), camera to this frame.
        frame_id: name in ROS.
        axes: axes in words.
    """

    T_frame_cam: Array = field(default_factory=lambda: np.eye(4))
    frame_id: str = CAMERA_FRAME
    axes: str = CAMERA_AXES


def pose_origin(tcp: str, model: Gripper, behind: float) -> tuple[float, str]:
    """Return metres along approach from the poses' origin to the contact line; the origin in words.

    The origin is the tool centre point `tcp`; if `tcp` is empty, the base, `behind` metres away.

    Raises:
        ValueRangeError: `tcp` is neither the name of a point nor a distance.
    """
    if not tcp:
        return behind, ExportGripper.origin
    distance = {"tips": model.flange_to_tip, "contacts": model.base_to_contacts}.get(tcp)
    if distance is None:
        try:
            distance = float(tcp)
        except ValueError:
            distance = np.nan
        if not 0.0 <= distance <= LONGEST_TOOL:
            raise ValueRangeError("--tcp", tcp, f"tips, contacts, or metres, 0 to {LONGEST_TOOL:g}")
    return model.base_to_contacts - distance, f"tool centre point ({tcp})"


def pose_frame(camera_to_base: Path | None, frame_id: str) -> PoseFrame:
    """Return the camera frame, or the robot's base frame of a hand-eye calibration.

    `frame_id`: name of the frame in ROS; empty for the file's name of it, else the default.

    Raises:
        FormatError: the file is no hand-eye calibration.
    """
    if camera_to_base is None:
        return PoseFrame(frame_id=frame_id or CAMERA_FRAME)
    found = read_hand_eye(camera_to_base)
    _warn_of_body(found)
    return _base_frame(found.T_base_cam, frame_id or found.base or BASE_FRAME)


def pose_frame_of_each(
    camera_to_base: Path | None, frame_id: str, names: Iterable[str]
) -> tuple[PoseFrame, Callable[[str], PoseFrame]]:
    """Return the frame of all exported poses, and the function from a frame's name to its own.

    The two differ in the camera's pose, if `camera_to_base` is a folder with a pose of each frame,
    as of a camera on the hand. The function raises a SymgraspError for a frame without a pose.
    `names`: of all frames.

    Raises:
        FormatError: `camera_to_base` is a file, and no hand-eye calibration.
    """
    if camera_to_base is None or not camera_to_base.is_dir():
        frame = pose_frame(camera_to_base, frame_id)
        return frame, lambda _name: frame
    folder, common = camera_to_base, _base_frame(np.eye(4), frame_id or BASE_FRAME)
    known: set[str] = set()  # cameras; each is warned of once
    shared = shared_last_parts(names)

    def of_frame(name: str) -> PoseFrame:
        found = read_hand_eye(find_frame_pose(folder, name, shared))
        if found.camera not in known:
            known.add(found.camera)
            _warn_of_body(found)
        return replace(common, T_frame_cam=found.T_base_cam)

    return common, of_frame


def _warn_of_body(found: HandEye) -> None:
    if found.is_of_body:
        log.warning(
            "the calibration is of %s: unless its z axis points forward, multiply the pose from "
            "the right by that of the camera's optical frame, which `ros2 run tf2_ros tf2_echo "
            "%s %s` prints",
            *(found.camera, found.camera, CAMERA_FRAME),
        )


def _base_frame(T_base_cam: Array, name: str) -> PoseFrame:
    axes = f"base of the robot, {name}; x, y, z as the hand-eye calibration has them"
    return PoseFrame(T_base_cam, name, axes)
