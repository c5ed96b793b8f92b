"""All grasps as one CSV table, one grasp per line; lines with # before the table explain it."""

import csv
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.errors import printable
from pipelines.grasp_files.exports.grasp_exports import ExportHeader, FrameGrasps, rounded
from pipelines.storage.files import atomic_path

FORMAT_VERSION = 2
TITLE = "SymGrasp grasps"
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # first characters of cells with formulas
FORMULA_CELL = re.compile(r"[,;](?=[=+\-@])")
COLUMNS = (
    *("frame", "rank_in_frame", "grasp", "region", "is_best", "rank_score", "worth_trying"),
    *("affordance", "source", "symmetry"),
    *(f"contact{finger}_{axis}" for finger in (1, 2) for axis in "xyz"),
    *("width", "opening", "pose_x", "pose_y", "pose_z"),
    *("pose_qx", "pose_qy", "pose_qz", "pose_qw", "instance"),
)


def write(path: Path, frames: Iterable[FrameGrasps], header: ExportHeader) -> None:
    """Write `frames`, one in memory at a time; a frame without grasps is a line with #."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as out:
        for key, value in _head(header).items():
            out.write(_comment(f"{key}: {value}"))
        table = csv.writer(out, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n")
        table.writerow(COLUMNS)
        for frame in frames:
            if not len(frame):
                name = json.dumps(frame.result.name, ensure_ascii=False)
                message = " ".join(frame.result.message.split())
                out.write(_comment(f"no grasps in {name} ({frame.result.status}): {message}"))
            table.writerows(_rows(frame))


def _comment(text: str) -> str:
    """Return a comment line in which no cell begins as a formula after a comma."""
    return f"# {FORMULA_CELL.sub(', ', printable(text))}\n"


def _as_text(name: str) -> str:
    """Return the relative path `name` so that no spreadsheet takes it for a formula."""
    return f"./{name}" if name.startswith(FORMULA_STARTS) else name


def is_ours(path: Path) -> bool:
    """Return whether the file starts like the files of `write`."""
    with path.open("rb") as stream:
        return stream.read(len(TITLE) + 2) == f"# {TITLE}".encode()


def _head(header: ExportHeader) -> dict[str, str]:
    return {
        TITLE: f"format version {FORMAT_VERSION}",
        "units": "metres",
        "axes": header.frame.axes,
        "pose": f"{header.gripper.words}; the contacts lie base_to_contacts before it along z",
        "gripper": json.dumps(header.gripper.facts()),
        "infer": json.dumps(header.infer),
        "provenance": json.dumps(header.stamp),
    }


def _rows(frame: FrameGrasps) -> Iterator[list[Any]]:
    table, quaternions, instances = frame.result.grasps, frame.quaternions, frame.instances
    contacts, position = frame.grasps.contacts.reshape(-1, 6), frame.poses[:, :3, 3]
    widths = frame.grasps.width, frame.opening
    numbers = np.column_stack([contacts, *widths, position, quaternions[:, [1, 2, 3, 0]]])
    for i, (row, symmetry) in enumerate(zip(rounded(numbers), frame.symmetries, strict=True)):
        yield [
            _as_text(frame.result.name),
            int(table.rank_in_frame[i]),
            int(frame.rows[i]),
            int(table.region[i]),
            int(table.is_best[i]),
            *rounded(table.rank_score[i : i + 1]),
            int(table.worth_trying[i]),
            *rounded(table.affordance[i : i + 1]),
            _as_text(str(table.source[i])),
            symmetry,
            *row,
            int(instances[i]),
        ]
