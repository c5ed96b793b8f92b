"""Grasps of a parallel gripper, and the grasp frame of the whole toolkit.

The columns of `rotation` are **approach, closing, approach x closing**: the gripper moves along
approach, the fingers close along closing, the last is the binormal. `translation` is the
**midpoint of the two contacts** (the paper's t), `width` the distance between them (the paper's d).
Half a turn about the approach axis swaps the fingers and gives the same grasp.

GraspNet has the same axes, but its origin is `depth` behind the finger tips along the approach, and
its width is the opening. Only `to_graspnet` and `from_graspnet` handle this difference.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Array
from pipelines.errors import ValueRangeError
from pipelines.geometry.transforms import (
    basis_from_direction,
    cross,
    make_pose,
    rotate_vectors,
    transform_points,
    unit,
)

Index = NDArray[np.bool_] | NDArray[np.integer] | slice

GRASPNET_HEIGHT = 0.02  # metres; a column that graspnetAPI ignores
ROTATION_TOLERANCE = 1e-4
PARALLEL = 1e-6  # sine below which an approach is parallel to the contact line
# The x, y, z of a gripper's base as columns in the grasp frame; both have z = approach.
# Closing along x: Contact-GraspNet, 6-DOF GraspNet, ACRONYM, GraspGen.
CLOSING_ALONG_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# Closing along y: links of grippers, as `panda_hand`, which MoveIt, ROS and Isaac move.
CLOSING_ALONG_Y = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


class RowColumn:
    """Columns of graspnetAPI's rows of 17 numbers; lengths in metres."""

    SCORE = 0
    WIDTH = 1  # the opening
    HEIGHT = 2
    DEPTH = 3  # from the origin to the finger tips
    ROTATION = slice(4, 13)  # row by row
    TRANSLATION = slice(13, 16)  # the origin, `DEPTH` behind the finger tips
    OBJECT_ID = 16
    COUNT = 17


@dataclass(frozen=True)
class GraspPoses:
    """Any number of grasps in one frame.

    Attributes:
        rotation: (n, 3, 3), columns approach, closing, approach x closing; determinant +1.
        translation: (n, 3) metres, midpoints of the contacts.
        width: (n,) metres, distances of the contacts.
    """

    rotation: Array
    translation: Array
    width: Array

    def __post_init__(self) -> None:
        R = np.asarray(self.rotation, np.float64).reshape(-1, 3, 3)
        t = np.asarray(self.translation, np.float64).reshape(-1, 3)
        d = np.asarray(self.width, np.float64).reshape(-1)
        counts = len(R), len(t), len(d)
        if len(set(counts)) > 1:
            raise ValueRangeError("numbers of rotations, translations and widths", counts, "equal")
        if not are_rotations(R):
            raise ValueRangeError("rotation", "not a rotation", "orthonormal, determinant +1")
        vars(self).update(rotation=R, translation=t, width=d)

    @classmethod
    def unchecked(cls, rotation: Array, translation: Array, width: Array) -> "GraspPoses":
        """Return the grasps with these attributes, float64 and of the right shapes, unchecked."""
        grasps = object.__new__(cls)
        vars(grasps).update(rotation=rotation, translation=translation, width=width)
        return grasps

    @classmethod
    def empty(cls) -> "GraspPoses":
        """Return no grasps."""
        return cls(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))

    @classmethod
    def from_contacts(cls, contacts: ArrayLike, approach: ArrayLike) -> "GraspPoses":
        """Return the grasps with `contacts` (n, 2, 3) along `approach` (n, 3).

        Only the part of `approach` perpendicular to the contact line counts; without such a part,
        any perpendicular direction is used. Closing points from the first contact to the second.
        """
        pair = np.asarray(contacts, np.float64)  # they give alpha, beta, t and d of Eq. 1
        line = pair[:, 1] - pair[:, 0]
        closing = unit(line)
        a = np.asarray(approach, np.float64)
        a = a - np.einsum("ni,ni->n", a, closing)[:, None] * closing
        along = np.linalg.norm(a, axis=1) < PARALLEL
        if along.any():
            a[along] = basis_from_direction(closing[along])[..., 1]
        a, width = unit(a), np.linalg.norm(line, axis=1)
        rotation = np.stack([a, closing, cross(a, closing)], -1)
        if not ((width > 0.0).all() and np.isfinite(rotation).all()):
            expected = "two points, apart and finite"
            raise ValueRangeError("contacts", "no line between them", expected)
        return cls.unchecked(rotation, 0.5 * (pair[:, 0] + pair[:, 1]), width)

    @classmethod
    def concatenate(cls, parts: Sequence["GraspPoses"]) -> "GraspPoses":
        """Return all grasps of `parts`, in order."""
        names, parts = (field.name for field in fields(cls)), [cls.empty(), *parts]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def __len__(self) -> int:
        return len(self.width)

    def __getitem__(self, index: Index) -> "GraspPoses":
        # Checked grasps are not checked again: a region's grasps are indexed some 30 times.
        return self.unchecked(self.rotation[index], self.translation[index], self.width[index])

    @property
    def approach(self) -> Array:
        """(n, 3) unit vectors from the gripper to the object."""
        return self.rotation[:, :, 0]

    @property
    def closing(self) -> Array:
        """(n, 3) unit vectors from the first contact to the second."""
        return self.rotation[:, :, 1]

    @property
    def binormal(self) -> Array:
        """(n, 3) unit vectors, approach x closing."""
        return self.rotation[:, :, 2]

    @property
    def contacts(self) -> Array:
        """(n, 2, 3) metres, the two contacts."""
        half = 0.5 * self.width[:, None] * self.closing
        return np.stack([self.translation - half, self.translation + half], 1)

    def at_approach_angles(self, index: Index, angle: Array) -> "GraspPoses":
        """Return the grasps `index` (m,), each turned by its `angle` (m,) about its contact line.

        At angle 0 a grasp is as given; a positive angle turns its approach toward the binormal.
        """
        R = self.rotation[index]
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        approach, binormal = R[:, :, 0], R[:, :, 2]
        rotation = R.copy()
        rotation[:, :, 0] = c * approach + s * binormal  # Eq. 2
        rotation[:, :, 2] = c * binormal - s * approach
        return self.unchecked(rotation, self.translation[index], self.width[index])

    def transformed(self, T: ArrayLike) -> "GraspPoses":
        """Return the grasps moved by the (4, 4) transform `T`."""
        return replace(
            self,
            rotation=rotate_vectors(T, self.rotation.swapaxes(1, 2)).swapaxes(1, 2),
            translation=transform_points(T, self.translation),
        )


def are_rotations(matrices: Array) -> bool:
    """Return whether all of `matrices` (n, 3, 3) are orthonormal with determinant +1."""
    # A contiguous row per coordinate takes a fifth of the time of small matrix products.
    a, b, c = np.ascontiguousarray(np.moveaxis(matrices, 0, 2)).swapaxes(0, 1)
    cross_ab = np.stack([a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))])
    off = [(a * a).sum(axis=0) - 1.0, (b * b).sum(axis=0) - 1.0, (a * b).sum(axis=0)]
    off += [*(cross_ab - c)]
    # Not "greater than", since comparisons with nan are False.
    return bool((np.abs(off) <= ROTATION_TOLERANCE).all())


def to_graspnet(
    grasps: GraspPoses,
    score: ArrayLike,
    *,
    depth: float,
    tip_reach: float,
    opening: ArrayLike | None = None,
) -> Array:
    """Return graspnetAPI's rows (n, 17).

    Args:
        grasps: in the camera frame.
        score: (n,) or one number, higher is better, the first column in GraspNet.
        depth: metres from GraspNet's origin to the finger tips.
        tip_reach: metres by which the finger tips pass the contact line along approach.
        opening: (n,) metres between the open fingers; the contact width if None.
    """
    rows = np.zeros((len(grasps), RowColumn.COUNT))
    rows[:, RowColumn.SCORE] = score
    rows[:, RowColumn.WIDTH] = grasps.width if opening is None else opening
    rows[:, RowColumn.HEIGHT], rows[:, RowColumn.DEPTH] = GRASPNET_HEIGHT, depth
    rows[:, RowColumn.ROTATION] = grasps.rotation.reshape(-1, 9)
    origin = grasps.translation + (tip_reach - depth) * grasps.approach
    rows[:, RowColumn.TRANSLATION] = origin
    rows[:, RowColumn.OBJECT_ID] = -1  # no known object
    return rows


def from_graspnet(rows: ArrayLike, *, tip_reach: float = 0.0) -> GraspPoses:
    """Return the grasps of graspnetAPI's `rows` (n, 17), in the frame of the rows.

    `width` is then the opening. `tip_reach`: as in `to_graspnet`; with 0, `translation` is between
    the finger tips.
    """
    rows = np.asarray(rows, np.float64).reshape(-1, RowColumn.COUNT)
    rotation = rows[:, RowColumn.ROTATION].reshape(-1, 3, 3)
    forward = (rows[:, RowColumn.DEPTH] - tip_reach)[:, None] * rotation[:, :, 0]
    translation = rows[:, RowColumn.TRANSLATION] + forward
    return GraspPoses(rotation, translation, rows[:, RowColumn.WIDTH])


def gripper_poses(grasps: GraspPoses, base_to_contacts: float, axes: Array) -> Array:
    """Return the poses (n, 4, 4) of the gripper base, for robot programs, in the frame of `grasps`.

    Args:
        grasps: in any frame.
        base_to_contacts: metres along approach, from the base's origin to the contact line.
        axes: (3, 3), `CLOSING_ALONG_X` or `CLOSING_ALONG_Y`.
    """
    behind = grasps.translation - base_to_contacts * grasps.approach
    return make_pose(grasps.rotation @ axes, behind)
