"""graspnetAPI's grasp rows, `.npy` of shape (N, 17), and the verdicts on them, `.npz`.

A row is score, width, height, depth, rotation (row-major, 9), translation (3), object id; metres.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Floats, Mask
from pipelines.dataset.graspnet.graspnet_labels import RECT_COLUMNS
from pipelines.errors import FormatError
from pipelines.geometry.transforms import nearest_orthogonal
from pipelines.grasping.grasps import RowColumn
from pipelines.storage.array_files import read_npy, write_npz
from pipelines.storage.provenance import Stamp, stamp_ahead

SAME = 1e-5  # a rotation with all entries this near to an exact rotation is left unchanged
MAX_SKEW = 1e-3  # largest error of a rotation's entries, as float16 rounds; beyond is no rotation
# Columns of lengths, without widths, which are limited, and heights, which are ignored.
LENGTHS = (RowColumn.DEPTH, *range(RowColumn.COUNT)[RowColumn.TRANSLATION])
FARTHEST = 100.0  # metres; no camera sees a grasp beyond, larger numbers are millimetres
VERDICT_ARRAYS = (
    "min_friction",
    "min_friction_grid",
    "contacts",
    "normals",
    "found",
    "antipodal",
    "collision",
    "empty",
)


@dataclass(frozen=True)
class GraspRows:
    """Rows of a file."""

    rows: Array  # (n, 17) float64; rows that are no grasps are zero, with a unit rotation
    faults: dict[int, str]  # row that is no grasp to the reason
    straightened: Mask  # (n,) whether an inexact rotation has been made exact


def read_grasp_rows(
    path: Path, *, max_width: float | None = None, max_skew: float = MAX_SKEW
) -> GraspRows:
    """Read grasp rows; make inexact rotations exact, and list the rows that are no grasps.

    Args:
        path: `.npy`.
        max_width: widths are limited to 0 and `max_width`, in the file's precision; if None,
            widths stay, and a negative width is a fault.
        max_skew: largest error of a rotation's entries that is corrected.

    Raises:
        FormatError: the file is not a plain array of 17 columns.
    """
    stored = _numbers(path)
    if max_width is not None:
        stored[:, RowColumn.WIDTH] = np.clip(stored[:, RowColumn.WIDTH], 0.0, max_width)
    rows = stored.astype(np.float64)
    given = rows[:, RowColumn.ROTATION]
    rotation = np.where(np.isfinite(given), given, 0.0).reshape(-1, 3, 3)
    nearest = nearest_orthogonal(rotation)
    skew = np.abs(nearest - rotation).max(axis=(1, 2))
    wrong = (skew > max_skew) | (np.linalg.det(nearest) < 0.0)
    found = {
        "holds numbers that are not finite": ~np.isfinite(rows).all(axis=1),
        "has no rotation in columns 4 to 12": wrong,
        "has a negative width": ~(rows[:, RowColumn.WIDTH] >= 0.0),
        "holds lengths beyond 100 metres": (abs(rows[:, LENGTHS]) > FARTHEST).any(1),
    }
    faults: dict[int, str] = {}
    for fault, has_it in found.items():
        for row in np.flatnonzero(has_it).tolist():
            faults.setdefault(row, fault)
    rounded = (skew > SAME) & ~wrong
    rows[rounded, RowColumn.ROTATION] = nearest[rounded].reshape(-1, 9)
    for row in faults:
        rows[row] = 0.0
        rows[row, RowColumn.ROTATION] = np.eye(3).ravel()
    rounded[list(faults)] = False
    return GraspRows(rows, faults, rounded)


def _numbers(path: Path) -> Floats:
    rows = read_npy(path)
    if rows.size == 0 and rows.dtype.kind in "fiu":
        return np.zeros((0, RowColumn.COUNT))
    if rows.ndim != 2 or rows.shape[1] != RowColumn.COUNT or rows.dtype.kind not in "fiu":
        found = f"an array of shape {rows.shape} and type {rows.dtype}"
        if rows.ndim == 2 and rows.shape[1] == RECT_COLUMNS:
            found += " (planar grasps in pixels)"
        expected = f"(N, {RowColumn.COUNT}) numbers, graspnetAPI's rows, are expected"
        raise FormatError(path, found, expected)
    return rows if rows.dtype.kind == "f" else rows.astype(np.float64)


def write_verdicts(path: Path, arrays: dict[str, NDArray[np.generic]], stamp: Stamp) -> None:
    """Write one array for each of `VERDICT_ARRAYS`, and the stamp next to the file."""
    stamp_ahead(path, stamp)
    write_npz(path, compress=True, **{name: arrays[name] for name in VERDICT_ARRAYS})
