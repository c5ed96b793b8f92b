"""The verdicts on one dumped scene, `report.scenes/scene_NNNN_CAMERA.npz`, one row per frame.

The row of a frame with fewer ranked grasps than another is filled up with nan or -1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.storage.array_files import read_npz, write_npz
from pipelines.storage.provenance import Stamp, write_sidecar

DUMP_STATUSES = ("ok", "missing", "unreadable")
NONE = np.zeros(0)


@dataclass(frozen=True)
class FrameVerdicts:
    """The verdicts on one frame of a dump and on each of its k ranked grasps."""

    frame_id: int  # of the dataset
    status: str  # one of `DUMP_STATUSES`
    message: str  # fault of the frame's file or rows; empty without a fault
    rows: int  # number of rows in the file
    left_out: int  # number of rows that are no grasps
    straightened: int  # number of rows whose rotations were made exact
    accuracy: Array  # (50, 6)
    row: NDArray[np.generic] = field(default_factory=lambda: NONE)  # (k,) index in the file
    object_id: NDArray[np.generic] = field(default_factory=lambda: NONE)  # (k,)
    confidence: NDArray[np.generic] = field(default_factory=lambda: NONE)  # (k,)
    friction: NDArray[np.generic] = field(default_factory=lambda: NONE)  # (k,) -1 if none holds
    reason: NDArray[np.generic] = field(default_factory=lambda: NONE)  # (k,) of `DUMP_REASONS`


def scenes_folder(report: Path) -> Path:
    """Return the folder of the verdicts of the report `report`, one file per scene."""
    return report.with_suffix(".scenes")


def write_dump_verdicts(path: Path, frames: Sequence[FrameVerdicts], stamp: Stamp) -> None:
    """Write the verdicts on a scene's frames, and the stamp next to them."""
    arrays: dict[str, NDArray[np.generic]] = {
        "frame_id": np.array([f.frame_id for f in frames], np.int32),
        "status": np.array([DUMP_STATUSES.index(f.status) for f in frames], np.int8),
        "message": np.array([f.message for f in frames], np.str_),
        "rows": np.array([f.rows for f in frames], np.int32),
        "left_out": np.array([f.left_out for f in frames], np.int32),
        "straightened": np.array([f.straightened for f in frames], np.int32),
        "accuracy": np.stack([f.accuracy for f in frames]),
        "row": _padded([f.row for f in frames], -1, np.int32),
        "object_id": _padded([f.object_id for f in frames], -1, np.int32),
        "confidence": _padded([f.confidence for f in frames], np.nan, np.float64),
        "friction": _padded([f.friction for f in frames], np.nan, np.float64),
        "reason": _padded([f.reason for f in frames], -1, np.int8),
    }
    write_npz(path, compress=True, **arrays)
    write_sidecar(path, stamp)


def read_dump_verdicts(path: Path) -> dict[str, NDArray[np.generic]]:
    """Read the arrays of a scene by the names of `FrameVerdicts`; frames are their first axis."""
    return dict(read_npz(path, [column.name for column in fields(FrameVerdicts)]))


def _padded(
    parts: Sequence[NDArray[np.generic]], fill: float, dtype: type[np.generic]
) -> NDArray[np.generic]:
    full = np.full((len(parts), max(map(len, parts), default=0)), fill, dtype)
    for row, part in zip(full, parts, strict=True):
        row[: len(part)] = part
    return full
