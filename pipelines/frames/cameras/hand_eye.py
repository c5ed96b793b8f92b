"""The camera's pose in the robot's base frame, from files of hand-eye calibrations.

Supported are a 4 x 4 matrix, or its first three rows, in JSON, YAML or numpy's .npz, bare or under
any key, or in numpy's .npy or .txt; the YAML of easy_handeye and easy_handeye2, and others with a
translation and a quaternion or a rotation matrix; and the launch file that MoveIt's calibration
saves. The camera's axes are those of its optical frame.
"""

import re
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.encodings.yaml_files import read_yaml
from pipelines.frames.frame_names import last_part
from pipelines.geometry.transforms import make_pose, nearest_orthogonal, quaternion_to_matrix
from pipelines.storage.array_files import read_npy, read_npz
from pipelines.storage.files import is_file, read_json, read_text

EXPECTED = (
    "a 4 x 4 matrix in JSON, YAML, .npy, .npz or .txt, or the YAML of easy_handeye or "
    "MoveIt's calibration, is expected: the camera's pose in the robot's base frame, metres"
)
FARTHEST = 20.0  # metres from a robot's base to its camera; larger distances are millimetres
MAX_SKEW = 5e-3  # largest error of a rotation, which is that of three digits
MAX_TEXT_BYTES = 2**16  # of a .launch or a .txt
MOST_NAMES = 4  # of poses that an error lists
POSE_SUFFIXES = (".json", ".yaml", ".yml", ".npy", ".txt")  # of the poses of single frames
POSITIONS = ("translation", "position", "translation_vector")
TURNS = ("rotation", "quaternion", "orientation")
MATRICES = ("rotation", "rotation_matrix")
LAST_ROW = (0.0, 0.0, 0.0, 1.0)
NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
LAUNCH = re.compile(rf"args=\"\s*((?:{NUMBER}\s+){{7}})(\S+)\s+([^\s\"]+)")
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
SAME_POSE = 1e-3  # largest difference of a pose that is written twice, as with few digits
ON_HAND = re.compile(r"eye[-_ ]?(?:in|on)[-_ ]?hand")
LONGEST_REMARK = 40  # characters of a text that states where the camera is
PARENT_KEYS = ("frame_id", "parent_frame", "parent", "robot_base_frame")
CHILD_KEYS = ("child_frame_id", "child_frame", "child", "tracking_base_frame", "camera_frame")
# Parts of the names of frames that move with the arm, and of poses in such frames.
MOVING = re.compile(r"(?<![a-z])(?:gripper|flange|effector|tcp|wrist|eef?|link8)(?![a-z])")
HAND = re.compile(rf"(?<![a-z])(?:hand|tool)(?![a-z])|{MOVING.pattern}")


@dataclass(frozen=True)
class HandEye:
    """A camera that is fixed next to a robot.

    Attributes:
        T_base_cam: (4, 4), camera to the robot's base, metres.
        base: name of the base's frame; empty if the file names none.
        camera: name of the camera's frame; empty if the file names none.
    """

    T_base_cam: Array
    base: str = ""
    camera: str = ""

    @property
    def is_of_body(self) -> bool:
        """Whether the camera's frame is, by its name in ROS, one with x forward (REP 103)."""
        return self.camera.endswith(("_link", "_frame")) and "optical" not in self.camera


def find_frame_pose(folder: Path, frame_name: str, shared: Container[str] = ()) -> Path:
    """Return the file of the camera's pose in one frame, in `folder`.

    Searches for `NAME.json`, `.yaml`, `.yml`, `.npy` and `.txt`, first with the frame's whole
    relative name, then with its last part only, unless this is among `shared`, the last parts that
    several frames share.

    Raises:
        SymgraspError: no such file.
    """
    last = last_part(frame_name)
    names = dict.fromkeys((frame_name, frame_name if last in shared else last))
    candidates = [folder / f"{name}{suffix}" for name in names for suffix in POSE_SUFFIXES]
    path = next(filter(is_file, candidates), None)
    if path is None:
        why = f", as several frames end in {last}" if last in shared else ""
        raise SymgraspError(f"{folder} has no camera pose for it; give {frame_name}.json{why}")
    return path


def read_hand_eye(path: Path) -> HandEye:
    """Read the result of a hand-eye calibration.

    Raises:
        FormatError: the file holds no pose or several, the pose of a camera on the hand, no rigid
            transform, or millimetres.
    """
    if path.suffix == ".launch":
        return _of_launch(path)
    content = _content(path)
    facts = content.get("parameters", content) if isinstance(content, dict) else {}
    facts = facts if isinstance(facts, dict) else {}
    name, pose = _only(path, list(_poses(path, content)))
    if _is_on_hand(content) or _is_moving(name.rpartition(".")[2].lower()):
        raise _on_hand(path)
    base = facts.get("robot_base_frame", "")
    camera = next(_cameras(content), "")
    return HandEye(_checked(path, pose), base if isinstance(base, str) else "", camera)


def _only(path: Path, found: list[tuple[str, Array]]) -> tuple[str, Array]:
    """Return the only pose and its name; matrices that are no transforms, such as K, do not count.

    Raises:
        FormatError: there is none, or there are several different ones.
    """
    if not found:
        raise FormatError(path, "holds no pose of a camera", EXPECTED)
    found = [each for each in found if _rotation(each[1]) is not None] or found[:1]
    first = found[0][1]
    others = [name for name, pose in found if not _is_same(pose, first)]
    if others:
        names = ", ".join([found[0][0], *others][:MOST_NAMES])
        cure = "keep the camera's pose in the robot's base frame alone"
        raise FormatError(path, f"holds several poses ({names})", cure)
    return found[0]


def _is_same(pose: Array, other: Array) -> bool:
    return np.allclose(pose, other, rtol=0.0, atol=SAME_POSE, equal_nan=True)


def _is_moving(name: str) -> bool:
    """Return whether a pose's name puts the camera in a frame that moves with the arm."""
    return bool(MOVING.search(name) or ON_HAND.search(name)) and "base" not in name


def _on_hand(path: Path) -> FormatError:
    return FormatError(
        path,
        "is of a camera on the hand, whose pose in the base frame moves with the arm",
        "multiply it by the flange's pose in the base, and save that 4 x 4 matrix as JSON",
    )


def _content(path: Path) -> object:
    if path.suffix == ".json":
        return read_json(path)
    if path.suffix == ".npy":
        return read_npy(path)
    if path.suffix == ".npz":
        return {name: each.tolist() for name, each in read_npz(path).items()}
    if path.suffix != ".txt":
        return read_yaml(path)
    try:
        return [float(each) for each in read_text(path, MAX_TEXT_BYTES).replace(",", " ").split()]
    except ValueError as error:
        raise FormatError(path, f"does not hold numbers alone ({error})", EXPECTED) from None


def _is_on_hand(content: object, key: str = "") -> bool:
    """Return whether a key, a short text or a parent frame at any level names the hand."""
    if isinstance(content, dict):
        return any(_is_on_hand(each, str(name).lower()) for name, each in content.items())
    text = str(content).lower() if isinstance(content, str | float | int) else ""
    if len(text) > LONGEST_REMARK:
        return False
    if key in PARENT_KEYS:
        return HAND.search(text) is not None
    states = bool(ON_HAND.search(key)) and text in ("true", "yes", "1", "1.0")
    return states or ON_HAND.search(text) is not None


def _cameras(content: object, key: str = "") -> Iterator[str]:
    """Yield the names of the camera's frame at any level of `content`."""
    if isinstance(content, dict):
        for name, each in content.items():
            yield from _cameras(each, str(name).lower())
    elif isinstance(content, str) and key in CHILD_KEYS:
        yield content


def _poses(path: Path, content: object, name: str = "") -> Iterator[tuple[str, Array]]:
    """Yield the poses (4, 4) that `content` holds, in its order, with their keys in the file."""
    matrix = _numbers(content)
    if matrix is not None and matrix.shape in ((4, 4), (16,), (3, 4), (12,)):
        yield name, np.vstack([matrix.reshape(-1, 4), LAST_ROW])[:4]
        return
    if not isinstance(content, dict):
        return
    flat = [_numbers(content.get(name)) for name in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    parts = [
        next((v for name in names if (v := _vector(content.get(name), axes)) is not None), None)
        for names, axes in ((POSITIONS, "xyz"), (TURNS, "xyzw"))
    ]
    turned = (_numbers(content.get(name)) for name in MATRICES)
    rotation = next((each for each in turned if each is not None and each.size == 9), None)
    if all(each is not None and each.shape == () for each in flat):
        yield name, _posed(path, np.array(flat[:3]), np.array(flat[3:]))
    elif parts[0] is not None and parts[1] is not None:
        yield name, _posed(path, parts[0], parts[1])
    elif parts[0] is not None and rotation is not None:
        yield name, make_pose(rotation.reshape(3, 3), parts[0])
    for key, each in content.items():
        yield from _poses(path, each, f"{name}.{key}".lstrip("."))


def _numbers(content: object) -> Array | None:
    """Return a number, or a rectangular list of numbers, as an array; None for anything else."""
    try:
        array = np.array(content)
    except ValueError:  # ragged
        return None
    return array.astype(np.float64) if array.dtype.kind in "fiu" else None


def _vector(content: object, axes: str) -> Array | None:
    """Return as many numbers as `axes`, from a list, or from a mapping with the axes as keys."""
    if isinstance(content, dict):
        content = [content.get(axis) for axis in axes]
    numbers = _numbers(content)
    return numbers.ravel() if numbers is not None and numbers.size == len(axes) else None


def _posed(path: Path, position: Array, xyzw: Array) -> Array:
    norm = float(np.linalg.norm(xyzw))
    if not abs(norm - 1.0) < MAX_SKEW:
        raise FormatError(path, f"has a quaternion of length {norm:.3g}", "1 is expected")
    return make_pose(quaternion_to_matrix(np.roll(xyzw, 1) / norm), position)


def _checked(path: Path, pose: Array) -> Array:
    """Return `pose` with an exact rotation.

    Raises:
        FormatError: `pose` is no rigid transform in metres.
    """
    rotation, position = _rotation(pose), pose[:3, 3]
    if rotation is None:
        raise FormatError(path, "has a matrix that is no rotation and translation", EXPECTED)
    if np.linalg.norm(position) > FARTHEST:
        found = f"puts the camera {np.linalg.norm(position):.0f} m from the base"
        raise FormatError(path, found, "metres are expected; divide millimetres by 1000")
    return make_pose(rotation, position)


def _rotation(pose: Array) -> Array | None:
    """Return the exact rotation (3, 3) of `pose`, None if it is no rigid transform."""
    if not (np.isfinite(pose).all() and np.allclose(pose[3], [0, 0, 0, 1], atol=1e-9)):
        return None
    exact = nearest_orthogonal(pose[None, :3, :3])[0]
    is_sound = np.abs(exact - pose[:3, :3]).max() < MAX_SKEW and np.linalg.det(exact) > 0
    return exact if is_sound else None


def _of_launch(path: Path) -> HandEye:
    """Read the static transform of a launch file, `x y z qx qy qz qw base camera`."""
    found = LAUNCH.findall(COMMENT.sub("", read_text(path, MAX_TEXT_BYTES)))
    if not found:
        raise FormatError(path, "publishes no static transform", EXPECTED)
    try:
        numbers = [np.array([float(each) for each in texts.split()]) for texts, *_names in found]
    except ValueError as error:
        raise FormatError(path, f"has a transform that is no numbers ({error})", EXPECTED) from None
    poses = [_posed(path, each[:3], each[3:]) for each in numbers]
    bases = [base for _texts, base, _camera in found]
    base, pose = _only(path, list(zip(bases, poses, strict=True)))
    if HAND.search(base.lower()):
        raise _on_hand(path)
    return HandEye(_checked(path, pose), base, found[0][2])
