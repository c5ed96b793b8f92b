"""graspnetAPI's grasp rows, `.npy` of shape (N, 17), and the verdicts on them, `.npz`.

A row is score, width, height, depth, rotation (row-major, 9), translation (3), object id; metres.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError
from pipelines.formats.files import read_npy, read_npz, write_npz
from pipelines.formats.provenance import Stamp, write_sidecar

Array = NDArray[np.float64]

COLUMNS = 17
RECT_COLUMNS = 7
SAME = 1e-5  # entries of a rotation this near to an exact one are left as they are
MAX_SKEW = 1e-3  # of a rotation as float16 rounds it; beyond this it is none
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
    """Rows (n, 17), float64, and which of them (n,) are no grasps, with the reason."""

    rows: Array
    faults: dict[int, str]


def read_grasp_rows(path: Path) -> GraspRows:
    """Read grasp rows; rotations a little off are made exact, rows that are none are named.

    Raises:
        FormatError: not a plain array of 17 columns.
    """
    rows = read_npy(path)
    if rows.ndim != 2 or rows.shape[1] != COLUMNS or rows.dtype.kind not in "fiu":
        found = f"an array of shape {rows.shape} and type {rows.dtype}"
        if rows.ndim == 2 and rows.shape[1] == RECT_COLUMNS:
            found += " (planar grasps in pixels)"
        raise FormatError(path, found, f"(N, {COLUMNS}) numbers, graspnetAPI's rows, are expected")
    rows = rows.astype(np.float64)
    faults = {int(i): "holds numbers that are not finite" for i in _not_finite(rows)}
    rotation = np.where(np.isfinite(rows[:, 4:13]), rows[:, 4:13], 0.0).reshape(-1, 3, 3)
    u, _, v = np.linalg.svd(rotation)
    nearest = u @ v
    skew = np.abs(nearest - rotation).max(axis=(1, 2))
    wrong = (skew > MAX_SKEW) | (np.linalg.det(nearest) < 0.0)
    for row in np.flatnonzero(wrong).tolist():
        faults.setdefault(row, "has no rotation in columns 4 to 12")
    rounded = (skew > SAME) & ~wrong
    rows[rounded, 4:13] = nearest[rounded].reshape(-1, 9)
    for row in np.flatnonzero(~(rows[:, 1] >= 0.0)).tolist():
        faults.setdefault(row, "has a negative width")
    for row in faults:
        rows[row] = 0.0
        rows[row, 4:13] = np.eye(3).ravel()
    return GraspRows(rows, faults)


def _not_finite(rows: Array) -> NDArray[np.int64]:
    return np.flatnonzero(~np.isfinite(rows).all(axis=1))


def write_verdicts(path: Path, arrays: dict[str, NDArray[np.generic]], stamp: Stamp) -> None:
    """Write one array for each of `VERDICT_ARRAYS`, and the stamp beside them."""
    write_npz(path, compress=True, **{name: arrays[name] for name in VERDICT_ARRAYS})
    write_sidecar(path, stamp)


def read_verdicts(path: Path) -> dict[str, NDArray[np.generic]]:
    """Read what `write_verdicts` wrote."""
    return dict(read_npz(path, VERDICT_ARRAYS))
