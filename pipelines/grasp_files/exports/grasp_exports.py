"""Grasps of a frame as gripper poses, ordered by rank: the common part of all exports."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask
from pipelines.errors import SymgraspError
from pipelines.geometry.symmetry import KIND_OF_SLOT
from pipelines.geometry.transforms import matrix_to_quaternion
from pipelines.grasp_files.exports.export_poses import ExportGripper, PoseFrame
from pipelines.grasp_files.grasp_checks import refuse_wrong_grasps
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable
from pipelines.grasping.grasps import CLOSING_ALONG_Y, GraspPoses, gripper_poses
from pipelines.grasping.gripper import Gripper
from pipelines.storage.files import LONGEST_NAME, real_path

LONGEST_PREFIX, LONGEST_SUFFIX = "predictions_", ".yaml"  # that a format adds to a frame's name
SLACK = 1e-6  # metres; widths are stored in single precision


@dataclass(frozen=True)
class FrameGrasps:
    """The exported grasps of a frame, best first."""

    # `result.grasps` holds the g exported grasps, with a new `rank_in_frame`.
    result: FrameResult
    rows: NDArray[np.int64]  # (g,) places in `/grasps` of grasps.h5
    left_out: NDArray[np.int64]  # (n,) places of grasps that are wider than the gripper opens
    low: NDArray[np.int64]  # (m,) places of other grasps that score too low
    grasps: GraspPoses  # the exported grasps in double precision, in the frame of `PoseFrame`
    gripper: ExportGripper  # the gripper of the poses

    @classmethod
    def of(
        cls,
        result: FrameResult,
        first_row: int,
        gripper: ExportGripper,
        min_score: float = 0.0,
        frame: PoseFrame | None = None,
    ) -> "FrameGrasps":
        """Return the exported grasps of a frame: all that `gripper` opens wide enough for.

        `first_row`: of the frame's grasps in /grasps. `frame`: of the poses; None for the camera
        frame.

        Raises:
            SymgraspError: as `refuse_wrong_grasps`.
        """
        table = result.grasps
        refuse_wrong_grasps(table)
        fits = that_fit(table, gripper.model)
        is_low = table.rank_score < np.float32(min_score)
        held, order = ranked_anew(table, fits & ~is_low)
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
        """Distance (g,) of the open fingers, metres."""
        return self.gripper.model.opening(self.grasps.width)

    @property
    def poses(self) -> Array:
        """Poses (g, 4, 4), gripper to the frame of `grasps`; axes as in `GRIPPER_AXES`."""
        return gripper_poses(self.grasps, self.gripper.base_to_contacts, CLOSING_ALONG_Y)

    @property
    def quaternions(self) -> Array:
        """Quaternions (g, 4) of `poses`, w first."""
        if not len(self):
            return np.zeros((0, 4))  # SciPy takes no empty stack
        return matrix_to_quaternion(self.poses[:, :3, :3])

    @property
    def symmetries(self) -> list[str]:
        """The kind of symmetry that gave each grasp's second contact, or `none`."""
        slots = self.result.grasps.symmetry_slot.tolist()
        return [KIND_OF_SLOT[slot] if slot >= 0 else "none" for slot in slots]

    @property
    def instances(self) -> NDArray[np.int32]:
        """Id (g,) of each grasp's region in the user's masks; -1 without masks."""
        return np.asarray(self.result.regions.instance[self.result.grasps.region])


@dataclass(frozen=True)
class ExportHeader:
    """The facts of a whole export: gripper and frame of the poses, and stamps."""

    gripper: ExportGripper
    frame: PoseFrame
    stamp: Mapping[str, Any]  # of the export, as JSON
    infer: Mapping[str, Any]  # stamp of the grasps.h5, as JSON


def that_fit(table: GraspTable, gripper: Gripper) -> Mask:
    """Return (g,) which grasps `gripper` opens wide enough for."""
    return np.asarray(table.width <= gripper.max_width + SLACK)


def ranked_anew(table: GraspTable, kept: Mask) -> tuple[GraspTable, NDArray[np.intp]]:
    """Return the `kept` (g,) grasps of a frame, best first with new ranks, and their places."""
    order = np.argsort(table.rank_in_frame)
    order = order[kept[order]]
    held = replace(table.taken(order), rank_in_frame=np.arange(len(order)))
    return _with_best(held), order


def _with_best(held: GraspTable) -> GraspTable:
    """Return `held` with a best grasp for each region: the next grasp if the best was left out."""
    is_best = held.is_best.copy()
    for region in np.setdiff1d(held.region, held.region[is_best]).tolist():
        is_best[np.flatnonzero(held.region == region)[0]] = True
    return replace(held, is_best=is_best)


def frame_path(name: str, prefix: str, suffix: str) -> Path:
    """Return the path of the file of the frame `name` in an output folder.

    Raises:
        SymgraspError: the name leads out of the folder, or is too long for a file.
    """
    place = PurePosixPath(name)
    if not place.name or place.is_absolute() or ".." in place.parts or "\\" in name:
        raise SymgraspError(f"the frame name {name!r} is no path within a folder; rename the frame")
    below = place.parent / f"{prefix}{place.name}{suffix}"
    if max(len(os.fsencode(part)) for part in below.parts) > LONGEST_NAME:
        raise SymgraspError(f"the frame name {name!r} is too long for a file; rename the frame")
    return Path(below)


class Claims:
    """The owners of the files in a folder, so that no frame's file replaces another's."""

    def __init__(self, *, folds_case: bool) -> None:
        """`folds_case`: whether names that differ only in case are one name."""
        self._folds_case = folds_case
        self._owners: dict[Path, str] = {}
        self._folders: set[Path] = set()

    def claim(self, path: Path, owner: str) -> None:
        """Note that the file `path` within the folder belongs to `owner`.

        Raises:
            SymgraspError: `path` belongs to another frame, is a folder, or would be in a file.
        """
        key = Path(str(path).casefold()) if self._folds_case else path
        for place in (key, *key.parents):
            if place in self._owners:
                owners = self._owners[place]
                raise SymgraspError(f"its file {path} would replace {owners}; rename the frame")
        if key in self._folders:
            raise SymgraspError(f"its file {path} is a folder of other frames; rename the frame")
        self._owners[key] = owner
        self._folders |= set(key.parents)


def folds_case(folder: Path) -> bool:
    """Return whether names in `folder` that differ only in case are one name, as on macOS."""
    folder = real_path(folder)
    for place in (folder, *folder.parents):
        swapped = place.parent / place.name.swapcase()
        if swapped != place and place.exists():
            return swapped.exists() and swapped.samefile(place)
    return False


def rounded(values: NDArray[Any]) -> list[Any]:
    """Return numbers for JSON, rounded to 9 decimals; None where a number is not finite."""
    flat = [round(v, 9) + 0.0 if np.isfinite(v) else None for v in values.ravel().tolist()]
    for length in reversed(values.shape[1:]):
        flat = [flat[i : i + length] for i in range(0, len(flat), length)]
    return flat
