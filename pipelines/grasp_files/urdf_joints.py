"""Joints of a URDF: their frames, axes and limits."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from pipelines.array_types import Array
from pipelines.errors import FormatError
from pipelines.geometry.transforms import make_pose

MOST_FOLLOWED = 20  # joints that mimic the next one; more may be a circle


@dataclass(frozen=True)
class UrdfJoint:
    """A joint: `T_parent_joint` (4, 4) at position 0, and `axis` (3,) of a sliding joint."""

    kind: str
    parent: str
    child: str
    T_parent_joint: Array
    axis: Array
    limits: tuple[float, float]


def joints_of(path: Path, root: Element) -> list[UrdfJoint]:
    """Return the joints of the robot `root` in the file `path`.

    Raises:
        FormatError: a joint has a value that is no number.
    """
    elements = {joint.get("name", ""): joint for joint in root.findall("joint")}
    return [_joint(path, joint, elements) for joint in root.findall("joint")]


def _joint(path: Path, joint: Element, elements: Mapping[str, Element]) -> UrdfJoint:
    ends = [joint.find(tag) for tag in ("parent", "child")]
    parent, child = ("" if end is None else end.get("link", "") for end in ends)
    axis = joint.find("axis")
    return UrdfJoint(
        joint.get("type", ""),
        parent,
        child,
        origin_of(path, joint),
        vector_in(path, None if axis is None else axis.get("xyz"), (1, 0, 0)),
        _limits(path, joint, elements),
    )


def _limits(path: Path, joint: Element, elements: Mapping[str, Element]) -> tuple[float, float]:
    """Return the limits of a joint; if it has none and mimics another, those that follow."""
    factor, offset = 1.0, 0.0
    lower, upper = _own_limits(path, joint)
    for _ in range(MOST_FOLLOWED):
        mimic = joint.find("mimic")
        driver = None if mimic is None else elements.get(mimic.get("joint", ""))
        if lower != upper or mimic is None or driver is None:
            break
        offset += factor * number_in(path, mimic.get("offset", "0"))
        factor *= number_in(path, mimic.get("multiplier", "1"))
        joint = driver
        lower, upper = _own_limits(path, joint)
    return factor * lower + offset, factor * upper + offset


def _own_limits(path: Path, joint: Element) -> tuple[float, float]:
    limit = joint.find("limit")
    names = ("lower", "upper")
    lower, upper = ("0" if limit is None else limit.get(name, "0") for name in names)
    return number_in(path, lower), number_in(path, upper)


def origin_of(path: Path, element: Element) -> Array:
    """Return the pose (4, 4) that `element` states in its parent's frame, metres."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    turn = Rotation.from_euler("xyz", vector_in(path, origin.get("rpy"), (0, 0, 0)))
    return make_pose(turn.as_matrix(), vector_in(path, origin.get("xyz"), (0, 0, 0)))


def vector_in(path: Path, text: str | None, default: tuple[float, float, float]) -> Array:
    """Return the three numbers (3,) of `text`, `default` without a text."""
    if text is None:
        return np.array(default, np.float64)
    values = np.array([number_in(path, part) for part in text.split()[:4]])
    if values.shape != (3,):
        raise FormatError(path, f"has the vector {text[:80]!r}", "three numbers are expected")
    return values


def number_in(path: Path, text: str | None) -> float:
    """Return the finite number of `text`."""
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        expected = "a number is expected; expand a xacro file by the program xacro"
        raise FormatError(path, f"has the value {str(text)[:80]!r}", expected)
    return value
