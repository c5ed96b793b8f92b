"""Grasp labels of GraspNet-1Billion: `grasp_label/NNN_labels.npz` and `collision_labels.npz`.

A label has arrays over (point, view, angle, depth), shape (P, 300, 12, 4): `scores` is the smallest
friction coefficient with which the grasp holds (0.1..1.0, lower is better, -1 = never), `collision`
is true if the gripper collides with the object, `offsets` = [angle rad, depth m, width m].
`points` (P, 3), metres, object frame, are the origins of the grasps: the finger tips reach `depth`
past the point along the approach.
"""

import math
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Floats, Indices, Mask, Singles
from pipelines.configs.dataset import MAX_LABEL_POINTS
from pipelines.dataset.graspnet.graspnet_views import (
    GRASP_DEPTHS,
    IN_PLANE_ANGLES,
    NUM_ANGLES,
    NUM_DEPTHS,
    NUM_VIEWS,
    view_rotations,
)
from pipelines.errors import FormatError
from pipelines.storage.array_files import (
    NPY_HEADER_BYTES,
    read_npy,
    read_npz,
    write_npy,
    write_npz,
)
from pipelines.storage.files import atomic_path, existing

LABEL_GRID = (NUM_VIEWS, NUM_ANGLES, NUM_DEPTHS)
LABEL_ARRAYS = ("points", "offsets", "collision", "scores")
# Of an object's collision labels, a byte each and the header. A scene has several such objects.
MAX_COLLISION_BYTES = MAX_LABEL_POINTS * math.prod(LABEL_GRID) + NPY_HEADER_BYTES
RECT_COLUMNS = 7  # center_x, center_y, open_x, open_y, height, score, object id; pixels


@dataclass(frozen=True)
class GraspLabel:
    """The label arrays of one object; the module's docstring explains them."""

    points: Singles  # (P, 3) metres, object frame
    offsets: Singles  # (P, 300, 12, 4, 3) angle, depth, width
    collision: Mask  # (P, 300, 12, 4)
    min_friction: Singles  # (P, 300, 12, 4); `scores` in the file, -1 = never holds


@dataclass(frozen=True)
class LabelledGrasps:
    """Labelled grasps that hold, one per row, object frame, metres."""

    index: Indices  # (n, 4) point, view, angle, depth
    rotation: Singles  # (n, 3, 3) columns approach, closing, approach x closing
    origin: Singles  # (n, 3) GraspNet's origin, `depth` behind the finger tips
    depth: Singles  # (n,) 0.01 .. 0.04
    opening: Singles  # (n,) `width` of the label: the opening, not the contact distance
    min_friction: Singles  # (n,) 0.1 .. 1.0, lower is better

    def __len__(self) -> int:
        return len(self.index)


def label_offsets(width: Floats) -> Singles:
    """Return `offsets` (P, 300, 12, 4, 3) for openings `width` (P, 300, 12, 4) in metres."""
    offsets = np.zeros((*width.shape, 3), dtype=np.float32)
    offsets[..., 0] = IN_PLANE_ANGLES[:, None]
    offsets[..., 1] = GRASP_DEPTHS
    offsets[..., 2] = width
    return offsets


def write_grasp_label(path: Path, label: GraspLabel, *, compress: bool = True) -> None:
    """Write `grasp_label/NNN_labels.npz` with the original's names and types."""
    write_npz(
        path,
        compress=compress,
        points=label.points.astype(np.float32),
        offsets=label.offsets.astype(np.float32),
        collision=label.collision.astype(bool),
        scores=label.min_friction.astype(np.float32),
    )


def join_grasp_labels(path: Path, parts: Sequence[Path], *, compress: bool = False) -> None:
    """Write `grasp_label/NNN_labels.npz` from its `parts`, label files of consecutive points.

    Only one array of one part is in memory at a time. By default uncompressed, as the published
    original; with `compress`, the file is about fifteen times smaller.
    """
    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name in LABEL_ARRAYS:
            # `ZipInfo` has a fixed date, so that the same label has the same bytes.
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = method
            with archive.open(member, "w", force_zip64=True) as stream:
                _write_joined(stream, parts, name)


def is_compressed(path: Path) -> bool:
    """Return whether the arrays of a label file are compressed.

    Raises:
        FormatError: the file is no whole label file.
    """
    try:
        with zipfile.ZipFile(existing(path)) as archive:
            return all(each.compress_type != zipfile.ZIP_STORED for each in archive.infolist())
    except zipfile.BadZipFile as error:
        found = f"this grasp label is damaged ({error})"
        raise FormatError(path, found, "run label-grasps with --overwrite") from error


def part_arrays(parts: Sequence[Path], name: str) -> Iterator[NDArray[Any]]:
    """Yield the array `name` of each of `parts`, reading no other array.

    Raises:
        FormatError: a part is no whole label file.
    """
    for part in parts:
        try:
            with existing(part).open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                array = arrays[name]
        except (ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
            found = f"this part of a grasp label is damaged ({error})"
            raise FormatError(part, found, "delete it and run label-grasps again") from error
        yield array


def _write_joined(stream: IO[bytes], parts: Sequence[Path], name: str) -> None:
    num_points = sum(len(points) for points in part_arrays(parts, "points"))
    for number, array in enumerate(part_arrays(parts, name)):
        if number == 0:
            header = {
                "descr": np.lib.format.dtype_to_descr(array.dtype),
                "fortran_order": False,
                "shape": (num_points, *array.shape[1:]),
            }
            np.lib.format.write_array_header_1_0(stream, header)
        stream.write(np.ascontiguousarray(array).data)


def holding_grasps(label: GraspLabel, max_friction: float = 1.0) -> LabelledGrasps:
    """Select the grasps of `label` that hold at `max_friction` without self-collision."""
    # The nearest float32 to 0.4 is larger than 0.4.
    holds = (label.min_friction > 0) & (label.min_friction <= max_friction + 1e-4)
    return chosen_grasps(label, holds & ~label.collision)


def chosen_grasps(label: GraspLabel, chosen: Mask) -> LabelledGrasps:
    """Return the candidates of `label` that are `chosen` (P, 300, 12, 4).

    A label of GraspNet has some fifty million candidates; the poses of the others are never built.
    """
    point, view, angle, depth = np.nonzero(chosen)
    offsets = label.offsets[point, view, angle, depth]
    return LabelledGrasps(
        index=np.stack([point, view, angle, depth], axis=1),
        rotation=view_rotations()[view, angle],
        origin=label.points[point],
        depth=offsets[:, 1],
        opening=offsets[:, 2],
        min_friction=label.min_friction[point, view, angle, depth],
    )


def write_collision_labels(path: Path, collisions: Sequence[Mask]) -> None:
    """Write a scene's `collision_labels.npz`: arr_i (P_i, 300, 12, 4) for its i-th object."""
    arrays = {f"arr_{i}": array.astype(bool) for i, array in enumerate(collisions)}
    write_npz(path, compress=True, **arrays)


def read_collision_labels(path: Path) -> list[Mask]:
    """Read arr_0, arr_1, ... in order; True = the grasp collides with the scene.

    Raises:
        FormatError: the file is damaged, an array is missing or misshaped, or an object has more
            points than labels are read with.
    """
    arrays = read_npz(path, bytes_of_each=MAX_COLLISION_BYTES)
    names = [f"arr_{i}" for i in range(len(arrays))]
    if sorted(arrays) != sorted(names):
        found = f"holds the arrays {sorted(arrays)}"
        raise FormatError(path, found, "arr_0, arr_1, ... without a gap are expected")
    for name in names:
        if arrays[name].ndim != 4 or arrays[name].shape[1:] != LABEL_GRID:
            raise FormatError(
                path, f"{name} has shape {arrays[name].shape}", f"(P, *{LABEL_GRID}) is expected"
            )
    return [arrays[name].astype(bool, copy=False) for name in names]


def write_rect(path: Path, rows: Floats) -> None:
    """Write planar grasps (N, 7), pixels, as float32; see RECT_COLUMNS."""
    write_npy(path, rows.astype(np.float32))


def read_rect(path: Path) -> Singles:
    """Read `rect/NNNN.npy`: (N, 7) float32 planar grasps, pixels."""
    rows = read_npy(path)
    if rows.ndim != 2 or rows.shape[1] != RECT_COLUMNS:
        raise FormatError(path, f"an array of shape {rows.shape}", "(N, 7) is expected")
    return rows.astype(np.float32)
