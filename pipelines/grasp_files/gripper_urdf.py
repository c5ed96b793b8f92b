"""The measures of a parallel gripper, from its URDF.

The fingers are the two links that slide (prismatic joints, one of which may mimic the other). The
palm is the link that they slide on, with all links fixed to it. Each part is measured by the bounds
of its collision bodies, or of its visual bodies if it has no collision bodies.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import parse as parse_urdf

from pipelines.array_types import Array
from pipelines.dataset.meshes import read_vertices
from pipelines.errors import FormatError, ValueRangeError
from pipelines.geometry.transforms import make_pose, transform_points, unit
from pipelines.grasp_files.urdf_joints import (
    UrdfJoint,
    joints_of,
    number_in,
    origin_of,
    vector_in,
)
from pipelines.grasping.gripper import Gripper
from pipelines.storage.files import existing, real_path

WRITE_BY_HAND = "a gripper with two sliding joints is expected; else write the ten lengths by hand"
MAX_LINKS = 1000
MOST_BESIDE = 0.005  # metres between the fingers' middle and the base's axis; meshes are uneven
SQUARE = 0.9  # smallest cosine between a finger's motion and an axis of the palm's frame


def read_urdf_gripper(
    path: Path, *, tip_reach: float, clearance: float, base_link: str = ""
) -> tuple[Gripper, list[str]]:
    """Return the gripper that a URDF describes, and where its base link is not that of poses.

    Args:
        path: of the URDF, of the gripper alone or of an arm with it.
        tip_reach: metres by which the tips are to pass the contacts.
        clearance: metres between a contact and an open finger.
        base_link: link with its origin on the mounting face; empty for the fingers' parent link.

    Raises:
        FormatError: the file is no URDF, has not two sliding fingers, lacks a mesh, or gives
            measures that no gripper has.
    """
    try:
        root = parse_urdf(existing(path)).getroot()
    except (ParseError, DefusedXmlException, ValueError) as error:
        raise FormatError(path, f"this is not XML ({error})", "a URDF is expected") from error
    links = {link.get("name", ""): link for link in (() if root is None else root.findall("link"))}
    if root is None or root.tag != "robot" or not 0 < len(links) <= MAX_LINKS:
        raise FormatError(path, "describes no robot", "a URDF is expected")
    joints = joints_of(path, root)
    if len({joint.child for joint in joints}) < len(joints):
        raise FormatError(path, "has a link with two parent joints", "a tree is expected")
    base = base_link or _palm(path, joints)
    if base not in links:
        raise FormatError(path, f"has no link {base!r}", f"its links: {', '.join(links)[:300]}")
    joints = _below(base, joints)
    sliding = sum(joint.kind == "prismatic" for joint in joints)
    if sliding != 2:
        raise FormatError(path, f"has {sliding} sliding joints below {base}", WRITE_BY_HAND)
    bodies = _Bodies(path, links, joints)
    return _measured(path, root.get("name", path.stem), bodies, base, tip_reach, clearance)


def _palm(path: Path, joints: Sequence[UrdfJoint]) -> str:
    """Return the link that two fingers slide on.

    Raises:
        FormatError: there is no such link, or several.
    """
    counted = Counter(joint.parent for joint in joints if joint.kind == "prismatic")
    palms = [link for link, count in counted.items() if count == 2]
    if len(palms) > 1:
        expected = f"name one of them as base link: {', '.join(palms)[:300]}"
        raise FormatError(path, f"has {len(palms)} grippers", expected)
    if not palms:
        found = f"has {counted.total()} sliding joints, and no link with just two of them"
        raise FormatError(path, found, WRITE_BY_HAND)
    return palms[0]


def _below(base: str, joints: Sequence[UrdfJoint]) -> list[UrdfJoint]:
    """Return the joints below the link `base`, in the order of the file."""
    below = {base}
    for _ in joints:  # at most as many links deep
        below |= {joint.child for joint in joints if joint.parent in below}
    return [joint for joint in joints if joint.parent in below and joint.child != base]


@dataclass
class _Bodies:
    """The links of a gripper, those below its base, as points."""

    path: Path
    links: dict[str, Element]
    joints: list[UrdfJoint]

    @property
    def sliding(self) -> list[UrdfJoint]:
        """The sliding joints."""
        return [joint for joint in self.joints if joint.kind == "prismatic"]

    def placed(self, base: str, ways: Mapping[str, float]) -> list[tuple[bool, Array]]:
        """Return points (n, 3) of `base` and of the links below, each with whether it is a finger.

        `ways`: position of each sliding joint, metres, by its child link.
        """
        found, todo = [], [(base, np.eye(4), False)]
        while todo:
            link, T, is_finger = todo.pop()
            points = self._points(self.links[link])
            if len(points):
                found.append((is_finger, transform_points(T, points)))
            below = [j for j in self.joints if j.parent == link and j.child in self.links]
            for joint in reversed(below):
                slide = make_pose(np.eye(3), ways.get(joint.child, 0.0) * joint.axis)
                T_below = T @ joint.T_parent_joint @ slide
                todo.append((joint.child, T_below, is_finger or joint.kind == "prismatic"))
        return found

    def rotation(self, joint: UrdfJoint, base: str) -> Array | None:
        """Return the rotation (3, 3), joint to base; None if the joint is not below `base`."""
        joint_of, R = {each.child: each for each in self.joints}, joint.T_parent_joint[:3, :3]
        for _ in joint_of:  # at most as many steps, also in a circle of links
            if joint.parent == base:
                return R
            if joint.parent not in joint_of:
                return None
            joint = joint_of[joint.parent]
            R = joint.T_parent_joint[:3, :3] @ R
        return None

    def _points(self, link: Element) -> Array:
        bodies = link.findall("collision") or link.findall("visual")
        parts = [np.zeros((0, 3)), *map(self._body, bodies)]
        return np.concatenate(parts)

    def _body(self, body: Element) -> Array:
        geometry = body.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            return np.zeros((0, 3))
        corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3)
        if shape.tag == "box":
            points = corners * vector_in(self.path, shape.get("size"), (0, 0, 0))
        elif shape.tag in ("cylinder", "sphere"):
            wide = 2 * number_in(self.path, shape.get("radius"))
            length = shape.get("length")
            points = corners * (wide, wide, number_in(self.path, length) if length else wide)
        else:
            scale = vector_in(self.path, shape.get("scale"), (1, 1, 1))
            points = read_vertices(self._mesh(shape.get("filename", ""))) * scale
        return transform_points(origin_of(self.path, body), points)

    def _mesh(self, name: str) -> Path:
        """Return the file of a mesh, sought next to the URDF and in the folders above."""
        plain = name.removeprefix("file://")
        below = plain.removeprefix("package://")
        inside = below.partition("/")[2] if below != plain else below
        for folder in (self.path.parent, *real_path(self.path).parents[:4]):
            for place in (below, inside):
                if place and (folder / place).is_file():
                    return folder / place
        raise FormatError(
            self.path, f"names a missing mesh, {name[:200]}", "add the mesh, or correct its name"
        )


def _measured(
    path: Path, name: str, bodies: _Bodies, base: str, tip_reach: float, clearance: float
) -> tuple[Gripper, list[str]]:
    """Return the gripper measured on `bodies`, and the oddities of the frame of the link `base`."""
    # A joint opens its finger at its upper or at its lower limit, as its axis points.
    limits = [[(joint.child, way) for way in joint.limits] for joint in bodies.sliding]
    at = [bodies.placed(base, dict(ways)) for ways in product(*limits)]
    if not all(any(is_finger for is_finger, _ in each) for each in at):
        raise FormatError(path, f"has no bodies on fingers below {base}", WRITE_BY_HAND)
    closing = _closing(path, bodies, base)
    middle = np.concatenate([points for is_finger, points in at[0] if is_finger]).mean(axis=0)
    approach = _approach(middle, closing)
    axes = np.stack([approach, closing, np.cross(approach, closing)])
    fingers = [_facing(path, [p @ axes.T for is_finger, p in each if is_finger]) for each in at]
    gap, finger = max(fingers, key=lambda each: each[0])
    third = (finger[:, 2].min() + finger[:, 2].max()) / 2
    middle = np.array([0.0, finger[:, 1].min() - gap / 2, third]) @ axes
    palms = [points @ axes.T for is_finger, points in at[0] if not is_finger]
    palm = np.concatenate(palms) if palms else np.zeros((1, 3))
    low, high, size = palm.min(axis=0), palm.max(axis=0), np.ptp(palm, axis=0)
    tips = float(finger[:, 0].max())
    measures = {
        "max_opening": gap,
        "finger_length": tips - float(high[0]),
        "finger_thickness": float(np.ptp(finger[:, 1])),
        "finger_height": float(np.ptp(finger[:, 2])),
        "palm_depth": float(high[0] - low[0]),
        "palm_width": float(size[1]),
        "palm_height": float(size[2]),
        "tip_reach": tip_reach,
        "clearance": clearance,
        "flange_to_tip": tips,
    }
    try:
        gripper = Gripper(name, **{key: round(value, 5) for key, value in measures.items()})
    except ValueRangeError as error:
        raise FormatError(path, f"has measures of no gripper ({error})", WRITE_BY_HAND) from error
    return gripper, _oddities(base, approach, closing, middle)


def _oddities(base: str, approach: Array, closing: Array, middle: Array) -> list[str]:
    """Return where the frame of `base` differs from that of poses, a phrase each.

    `middle` (3,) is between the open fingers, square to `approach`, metres, in the base's frame.
    """
    odd = []
    if (across := "xyz"[int(closing.argmax())]) != "y":
        odd.append(f"the fingers close along {across} of {base}, not along y")
    place = int(np.abs(approach).argmax())
    if approach[2] != 1.0:
        sign = "-" if approach[place] < 0 else ""
        odd.append(f"the fingers point along {sign}{'xyz'[place]} of {base}, not along z")
    if np.abs(middle).max() > MOST_BESIDE:
        beside = ", ".join(str(round(1000 * each)) for each in middle.tolist())
        odd.append(f"the fingers' middle is {beside} mm in x, y, z beside the axis of {base}")
    return [f"{each}; poses of {base} need one more fixed transform" for each in odd]


def _facing(path: Path, fingers: list[Array]) -> tuple[float, Array]:
    """Return the gap between the two fingers, and the points (n, 3) of the second finger.

    `fingers`: points of each body, axes approach, closing and their cross product.

    Raises:
        FormatError: all bodies are on one side.
    """
    center = float(np.mean([points[:, 1].mean() for points in fingers]))
    sides: tuple[list[Array], list[Array]] = ([], [])
    for points in fingers:
        sides[int(points[:, 1].mean() >= center)].append(points)
    if not all(sides):
        raise FormatError(path, "has fingers that do not face each other", WRITE_BY_HAND)
    first, second = map(np.concatenate, sides)
    return float(second[:, 1].min() - first[:, 1].max()), second


def _closing(path: Path, bodies: _Bodies, base: str) -> Array:
    """Return the axis of the base's frame that the fingers slide along.

    Raises:
        FormatError: the fingers slide along no axis of this frame.
    """
    turns = ((joint, bodies.rotation(joint, base)) for joint in bodies.sliding)
    axes = [unit(R @ joint.axis) for joint, R in turns if R is not None]
    places = [int(np.argmax(np.abs(axis))) for axis in axes]
    if len(axes) < 2 or len(set(places)) > 1 or not np.abs(axes).max(axis=1).min() >= SQUARE:
        raise FormatError(path, f"has fingers that slide askew to {base}", WRITE_BY_HAND)
    return np.asarray(np.eye(3)[places[0]])


def _approach(middle: Array, closing: Array) -> Array:
    """Return the signed axis of the base's frame, square to `closing`, towards the fingers."""
    across = middle * (1.0 - closing)
    place = int(np.argmax(np.abs(across)))
    return np.asarray(np.eye(3)[place] * (1.0 if across[place] >= 0 else -1.0))
