"""Grasps of a frame as poses of a gripper, in the frame's order: the common part of all exports."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.errors import SymgraspError
from pipelines.geometry.symmetry import KIND_OF_SLOT
from pipelines.geometry.transforms import matrix_to_quaternion
from pipelines.grasp_files.exports.export_poses import ExportGripper, PoseFrame
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable
from pipelines.grasping.grasps import CLOSING_ALONG_Y, GraspPoses, gripper_poses
from pipelines.storage.files import LONGEST_NAME, real_path

LONGEST_PREFIX, LONGEST_SUFFIX = "predictions_", ".yaml"  # that any format puts to a frame's name
SLACK = 1e-6  # metres; widths are stored in single precision


@dataclass(frozen=True)
class FrameGrasps:
    """The grasps of a frame that are exported, best first."""

    # The frame; its `grasps` are the g exported ones, numbered anew by `rank_in_frame`.
    result: FrameResult
    rows: NDArray[np.int64]  # (g,) places in `/grasps` of grasps.h5
    left_out: NDArray[np.int64]  # (n,) places of those that are wider than the gripper opens
    low: NDArray[np.int64]  # (m,) places of others that score too low
    grasps: GraspPoses  # the exported ones in double precision, in the frame of `PoseFrame`
    gripper: ExportGripper  # whose poses they are

    @classmethod
    def of(
        cls,
        result: FrameResult,
        first_row: int,
        gripper: ExportGripper,
        min_score: float = 0.0,
        frame: PoseFrame | None = None,
    ) -> "FrameGrasps":
        """Return what is exported of a frame: what `gripper` opens wide enough for.

        `first_row`: of its grasps in /grasps. `frame`: of the poses; None for the camera's.

        Raises:
            SymgraspError: a pose is not finite, or no rotation.
        """
        table = result.grasps
        for name in ("rotation", "translation", "width", "contacts"):
            if not np.isfinite(getattr(table, name)).all():
                raise SymgraspError(f"the {name} of a grasp is not finite; run infer again")
        fits = table.width <= gripper.model.max_width + SLACK
        is_low = table.rank_score < np.float32(min_score)
        order = np.argsort(table.rank_in_frame)
        order = order[(fits & ~is_low)[order]]
        held = _with_best(replace(table.taken(order), rank_in_frame=np.arange(len(order))))
        rows = first_row + np.arange(len(table))
        u, _, v = np.linalg.svd(held.rotation.astype(np.float64))  # stored in single precision
        grasps = GraspPoses(u @ v, held.translation, held.width)
        if frame is not None:
            grasps = grasps.transformed(frame.T_frame_cam)
        left_out, low = rows[~fits], rows[fits & is_low]
        return cls(replace(result, grasps=held), rows[order], left_out, low, grasps, gripper)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def opening(self) -> Array:
        """(g,) metres between the open fingers."""
        return self.gripper.model.opening(self.grasps.width)

    @property
    def poses(self) -> Array:
        """(g, 4, 4) gripper to the frame of `grasps`; axes as `GRIPPER_AXES` says."""
        return gripper_poses(self.grasps, self.gripper.base_to_contacts, CLOSING_ALONG_Y)

    @property
    def quaternions(self) -> Array:
        """(g, 4), w first, of `poses`."""
        if not len(self):
            return np.zeros((0, 4))  # SciPy takes no empty stack
        return matrix_to_quaternion(self.poses[:, :3, :3])

    @property
    def symmetries(self) -> list[str]:
        """The kind of symmetry that gave each grasp's second contact; none where none did."""
        slots = self.result.grasps.symmetry_slot.tolist()
        return [KIND_OF_SLOT[slot] if slot >= 0 else "none" for slot in slots]


@dataclass(frozen=True)
class ExportHeader:
    """The facts of a whole export: whose poses, in which frame, and how it was made."""

    gripper: ExportGripper
    frame: PoseFrame
    stamp: Mapping[str, Any]  # of the export, as JSON
    infer: Mapping[str, Any]  # stamp of the grasps.h5, as JSON


def _with_best(held: GraspTable) -> GraspTable:
    """Return `held` where each region has a best grasp: the next one if it was left out."""
    is_best = held.is_best.copy()
    for region in np.setdiff1d(held.region, held.region[is_best]).tolist():
        is_best[np.flatnonzero(held.region == region)[0]] = True
    return replace(held, is_best=is_best)


def frame_path(name: str, prefix: str, suffix: str) -> Path:
    """Return where in a folder the file of the frame `name` goes.

    Raises:
        SymgraspError: the name leads out of the folder, or is longer than a file's may be.
    """
    place = PurePosixPath(name)
    if not place.name or place.is_absolute() or ".." in place.parts or "\\" in name:
        raise SymgraspError(f"the frame's name {name!r} is no path within a folder; rename it")
    below = place.parent / f"{prefix}{place.name}{suffix}"
    if max(len(os.fsencode(part)) for part in below.parts) > LONGEST_NAME:
        raise SymgraspError(f"the frame's name {name!r} is too long for a file's; rename it")
    return Path(below)


class Claims:
    """Which files of a folder are whose, so that no frame's file takes another's place."""

    def __init__(self, *, folds_case: bool) -> None:
        """`folds_case`: whether names that differ in case alone are one."""
        self._folds_case = folds_case
        self._owners: dict[Path, str] = {}
        self._folders: set[Path] = set()

    def claim(self, path: Path, owner: str) -> None:
        """Note that the file `path` within the folder is that of `owner`.

        Raises:
            SymgraspError: it is another's, a folder of others', or would lie in a file.
        """
        key = Path(str(path).casefold()) if self._folds_case else path
        for place in (key, *key.parents):
            if place in self._owners:
                owners = self._owners[place]
                raise SymgraspError(f"its file {path} would take the place of {owners}; rename it")
        if key in self._folders:
            raise SymgraspError(f"its file {path} is a folder of other frames; rename it")
        self._owners[key] = owner
        self._folders |= set(key.parents)


def folds_case(folder: Path) -> bool:
    """Return whether names in `folder` that differ in case alone are one, as macOS takes them."""
    folder = real_path(folder)
    for place in (folder, *folder.parents):
        swapped = place.parent / place.name.swapcase()
        if swapped != place and place.exists():
            return swapped.exists() and swapped.samefile(place)
    return False


def rounded(values: NDArray[Any]) -> list[Any]:
    """Return numbers as JSON has them, to a nanometre; null where they are not finite."""
    flat = [round(v, 9) + 0.0 if np.isfinite(v) else None for v in values.ravel().tolist()]
    for length in reversed(values.shape[1:]):
        flat = [flat[i : i + length] for i in range(0, len(flat), length)]
    return flat
