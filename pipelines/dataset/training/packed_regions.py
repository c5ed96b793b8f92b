"""`PACKED/scene_NNNN_CAMERA.h5`: the region clouds of a scene's frames, with their labels.

Camera frame (OpenCV axes), metres. Slots as in `geometry/symmetry.py`: 0-2 reflection, 3 rotation,
4 sphere; the point and direction of an empty slot are nan.
"""

import bisect
import itertools
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask, Singles
from pipelines.errors import FormatError, MissingInputError
from pipelines.geometry.symmetry import NUM_SLOTS, SPHERE_SLOT
from pipelines.storage.h5_columns import (
    ColumnSpec,
    check_version,
    coerce_columns,
    read_columns,
    write_columns,
)
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import Stamp

FORMAT_VERSION = 2
UNITS = {"points": "m", "point": "m"}
FARTHEST = 100.0  # metres from the camera; millimetres instead of metres are farther
UNIT_ERROR = 1e-3  # largest error of the length of a unit vector
MOST_OPEN = 200  # open files; systems allow a process about 1,024
# The large arrays: one row per chunk and uncompressed, so that training reads rows in any order at
# the speed of the disk. The other columns are small and kept in memory.
BY_ROW = ("points", "affordance")


@dataclass(frozen=True)
class PackedScene:
    """The R packed regions of one scene, P points each."""

    points: NDArray[Any]  # f4 (R, P, 3) metres, camera frame
    affordance: NDArray[Any]  # f4 (R, P) 0..1
    existence: NDArray[Any]  # f4 (R, 5) 0 or 1
    point: NDArray[Any]  # f4 (R, 5, 3) metres, camera frame
    direction: NDArray[Any]  # f4 (R, 5, 3) unit, camera frame
    table: NDArray[Any]  # f4 (R, 4) normal and offset (metres), camera frame; nan: none found
    object_id: NDArray[Any]  # i4 (R,)
    frame_id: NDArray[Any]  # i4 (R,)
    name: NDArray[Any]  # str (R,), the region's name

    def __post_init__(self) -> None:
        regions, count = np.shape(self.points)[:2]
        coerce_columns(self, _spec(count), regions)

    def __len__(self) -> int:
        return len(self.points)


def _spec(count: int) -> ColumnSpec:
    """Return the columns of regions of `count` points."""
    return {
        "points": ((count, 3), np.float32),
        "affordance": ((count,), np.float32),
        "existence": ((NUM_SLOTS,), np.float32),
        "point": ((NUM_SLOTS, 3), np.float32),
        "direction": ((NUM_SLOTS, 3), np.float32),
        "table": ((4,), np.float32),
        "object_id": ((), np.int32),
        "frame_id": ((), np.int32),
        "name": ((), np.object_),
    }


@dataclass(frozen=True)
class PackedRegion:
    """One packed region; the fields of `PackedScene` without their first axis."""

    points: Singles  # (P, 3)
    affordance: Singles  # (P,)
    existence: Singles  # (5,)
    point: Singles  # (5, 3)
    direction: Singles  # (5, 3)
    table: Singles  # (4,)
    object_id: int
    frame_id: int
    name: str


COLUMNS = tuple(field.name for field in fields(PackedScene))


def write(path: Path, scene: PackedScene, stamp: Stamp) -> None:
    """Write one scene; same regions and stamp, same bytes."""
    with new_h5(path) as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["frame"] = "camera, OpenCV axes"
        file.attrs["provenance"] = stamp.as_text()
        columns = {name: getattr(scene, name) for name in COLUMNS}
        write_columns(file, columns, UNITS, BY_ROW)


def read(path: Path) -> PackedScene:
    """Read a whole scene."""
    with open_h5(path) as file:
        check_version(path, file.attrs.get("format_version"), FORMAT_VERSION)
        return PackedScene(**read_columns(path, file, COLUMNS))


def packed_files(folder: Path) -> list[Path]:
    """Return every `*.h5` under a folder, which are what training reads, in order."""
    return sorted(path for path in folder.rglob("*.h5") if not path.name.startswith("."))


def scenes_with_regions(paths: Iterable[Path], counts: Iterable[int]) -> list[str]:
    """Return the names of scenes with regions, ascending; `counts`: regions of each of `paths`."""
    return sorted({scene_of(path) for path, count in zip(paths, counts, strict=True) if count})


def scene_of(path: Path) -> str:
    """Return the name of the scene of a packed file: `scene_NNNN`, or the file's name."""
    found = re.match(r"scene_\d+", path.stem)
    return found.group() if found else path.stem


@dataclass(frozen=True)
class _OpenScene:
    """An open file: datasets to read row by row, and columns in memory."""

    rows: dict[str, h5py.Dataset]
    columns: dict[str, NDArray[Any]]

    @classmethod
    def of(cls, path: Path) -> "_OpenScene":
        file = open_h5(path, cache_bytes=0, checked=False)  # rows come in random order
        small = [name for name in COLUMNS if name not in BY_ROW]
        columns, rows = read_columns(path, file, small), {name: file.get(name) for name in BY_ROW}
        for name, dataset in rows.items():
            if not isinstance(dataset, h5py.Dataset) or dataset.ndim < 2:
                raise FormatError(path, f"/{name} is missing or cut off", "pack the scene again")
        regions, count = rows["points"].shape[:2]
        for name, column in {**columns, **rows}.items():
            shape = (regions, *_spec(count)[name][0])
            if column.shape != shape:
                found = f"/{name} has the shape {column.shape}, not {shape}"
                raise FormatError(path, found, "pack the scene again")
            if name != "name" and column.dtype.kind not in "fiu":
                raise FormatError(path, f"/{name} holds no numbers", "pack the scene again")
        _check_labels(path, columns)
        return cls(rows, columns)

    def region(self, row: int) -> PackedRegion:
        columns = {name: column[row] for name, column in self.columns.items()}
        columns |= {name: dataset[row] for name, dataset in self.rows.items()}
        columns |= {name: int(columns[name]) for name in ("object_id", "frame_id")}
        return PackedRegion(**columns)


class PackedReader:
    """Random access to the regions of every `*.h5` under a folder; files are opened when needed.

    A reader may be passed to the workers of a data loader: it pickles without its open files and
    reopens them in a forked process. Hidden files, left by an interrupted `pack`, are ignored.
    """

    def __init__(self, folder: Path) -> None:
        if (folder / "scenes").is_dir():
            raise FormatError(
                folder, "is a dataset root", "give the output folder of `symgrasp pack`"
            )
        self.paths = tuple(packed_files(folder))
        if not self.paths:
            raise MissingInputError(folder / "*.h5", "symgrasp pack")
        self.counts = tuple(map(count_regions, self.paths))
        self._ends = list(itertools.accumulate(self.counts))
        self._scenes: dict[int, _OpenScene] = {}  # in order of last use
        self._process = os.getpid()

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, index: int) -> PackedRegion:
        """Return region `index`, counted through the files in order of their names.

        Raises:
            FormatError: the region is damaged, or its labels are out of range.
        """
        scene, row = self.locate(index)
        opened = self._open(scene)
        try:
            region = opened.region(row)
        except OSError as error:
            raise FormatError(
                self.paths[scene], f"region {row} is damaged ({error})", "pack again"
            ) from error
        if not (np.abs(region.points) <= FARTHEST).all():
            found = f"region {row} has points that are not finite or beyond {FARTHEST:.0f} m"
            raise FormatError(self.paths[scene], found, "pack the scene again")
        if not ((region.affordance >= 0.0) & (region.affordance <= 1.0)).all():
            found = f"region {row} has affordances outside of 0 to 1"
            raise FormatError(self.paths[scene], found, "pack the scene again")
        return region

    def locate(self, index: int) -> tuple[int, int]:
        """Return (index into `paths`, row in that file) of region `index`."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"region {index} of {len(self)}")
        index %= len(self)
        scene = bisect.bisect_right(self._ends, index)
        return scene, index - (self._ends[scene] - self.counts[scene])

    def _open(self, scene: int) -> _OpenScene:
        if self._process != os.getpid():  # open files must not be shared with the parent process
            self._scenes, self._process = {}, os.getpid()
        opened = self._scenes.pop(scene, None) or _OpenScene.of(self.paths[scene])
        while len(self._scenes) >= MOST_OPEN:
            del self._scenes[next(iter(self._scenes))]  # h5py closes unreferenced files
        self._scenes[scene] = opened
        return opened

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_scenes": {}, "_process": -1}


def _check_labels(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Raise FormatError if a symmetry or a table is no plane, axis or point.

    Such labels would make the loss of a whole batch, or of the validation, meaningless.
    """
    existence, table = columns["existence"], columns["table"]
    exists, headed = existence > 0.0, np.arange(NUM_SLOTS) != SPHERE_SLOT
    faults = {
        "an existence outside of 0 to 1": ~((existence >= 0.0) & (existence <= 1.0)),
        "a symmetry without a point": exists & ~np.isfinite(columns["point"]).all(-1),
        "a symmetry without a unit direction": exists & headed & ~_are_units(columns["direction"]),
        "a table without a unit normal": (np.isfinite(table).all(-1) & ~_are_units(table[:, :3]))[
            :, None
        ],
    }
    for fault, rows in faults.items():
        if rows.any():
            row = int(rows.any(-1).argmax())
            raise FormatError(path, f"region {row} has {fault}", "pack the scene again")


def _are_units(vectors: NDArray[Any]) -> Mask:
    """Return which of `vectors` (..., 3) have unit length; nan has not."""
    length = np.linalg.norm(vectors.astype(np.float64), axis=-1)
    return np.asarray(np.abs(length - 1.0) < UNIT_ERROR)


def count_regions(path: Path) -> int:
    """Return the number of regions in a packed file."""
    with open_h5(path, checked=False) as file:  # unchecked: all files are opened before training
        check_version(path, file.attrs.get("format_version"), FORMAT_VERSION)
        points = file.get("points")
        if not isinstance(points, h5py.Dataset) or points.ndim != 3:
            raise FormatError(path, "has no clouds in /points", "pack the scene again")
        return int(points.shape[0])
