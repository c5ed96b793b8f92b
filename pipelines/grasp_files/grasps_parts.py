"""Writing of `grasps.h5` from the parts of its frames, a few at a time, with constant memory.

The rows of all parts are counted first, then filled in.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
from h5py import h5d, h5g

from pipelines.errors import SymgraspError
from pipelines.grasp_files.grasps_file import (
    FORMAT_VERSION,
    UNITS,
    file_attributes,
    opened,
    read_part,
    stored_intrinsics,
    write_attributes,
)
from pipelines.grasp_files.grasps_tables import (
    NO_FRAMES,
    FrameResult,
    GraspTable,
    RegionTable,
    Tables,
    joined_tables,
    tables_of,
)
from pipelines.storage.array_files import DAMAGED
from pipelines.storage.h5_columns import make_column, read_alike
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import Stamp

COUNTED = ("regions/frame", "grasps/frame", "regions/mask_counts")
BATCH = 64  # frames in memory while parts are put together


def merge_parts(
    path: Path,
    parts: Sequence[FrameResult | Path],
    stamp: Stamp,
    weights: Mapping[str, str] | None = None,
    check: Callable[[], None] = lambda: None,
) -> None:
    """Write the frames `parts`, parts or results, as `grasps_file.write` would.

    `check`: called between parts; if it raises, nothing is written.

    Raises:
        FormatError: a part is damaged.
    """
    sizes = _sizes(parts, check)
    with new_h5(path) as file:
        write_attributes(file, stamp, weights)
        _make_columns(file, sizes)
        done = dict.fromkeys(sizes, 0)
        for start in range(0, len(parts), BATCH):
            check()
            batch = parts[start : start + BATCH]
            tables = [part_tables(p) if isinstance(p, Path) else tables_of([p]) for p in batch]
            _fill(file, joined_tables(tables), done)


def _sizes(parts: Sequence[FrameResult | Path], check: Callable[[], None]) -> dict[str, int]:
    """Return the number of rows of all `parts` in each group and in `mask_counts`."""
    sizes = np.zeros(3, np.int64)
    for part in parts:
        check()
        if isinstance(part, Path):
            sizes += part_sizes(part)
        else:
            sizes += len(part.regions), len(part.grasps), len(part.regions.mask_counts)
    names = ("regions", "grasps", "mask_counts")
    return {"frames": len(parts), **dict(zip(names, sizes.tolist(), strict=True))}


def part_sizes(path: Path) -> tuple[int, ...]:
    """Return the numbers of regions, grasps and mask runs of a part; check nothing else.

    Raises:
        FormatError: the part is damaged.
    """
    try:
        with open_h5(path) as file:
            return tuple(int(h5d.open(file.id, name.encode()).shape[0]) for name in COUNTED)
    except DAMAGED:
        with opened(path) as file:
            return tuple(len(file[name]) for name in COUNTED)


def part_tables(path: Path) -> Tables:
    """Return the columns of one frame's part, equal to `tables_of` for that frame.

    A part exactly as written by `grasps_file.write` is read by HDF5's low-level handles, several
    times faster than by `read_part`. Any other part is left to `read_part`, which reads it or
    names its fault.

    Raises:
        FormatError: as in `read_part`.
    """
    try:
        with open_h5(path) as file:
            tables = _columns_of_part(file)
    except (*DAMAGED, SymgraspError):
        tables = None
    return tables or tables_of([read_part(path)])


def _columns_of_part(file: h5py.File) -> Tables | None:
    """Return the columns of a part of this version; None if anything differs from the format.

    Raises:
        SymgraspError: the columns disagree.
    """
    attrs = file_attributes(file)  # reads all attributes, to find damage
    if int(attrs["format_version"]) != FORMAT_VERSION:
        return None
    tables: Tables = {}
    for group, examples in NO_FRAMES.items():
        columns = read_alike(h5g.open(file.id, group.encode()), examples)
        if columns is None:
            return None
        tables[group] = columns
    frames, regions, grasps = tables.values()
    rows = {len(column) for column in grasps.values()}
    if len(rows) > 1 or any(len(column) != 1 for column in frames.values()):
        return None
    tables_of_frame = RegionTable(**regions), GraspTable(**grasps)
    camera = stored_intrinsics(frames["size"][0], frames["intrinsics"][0])
    FrameResult("", frames["status"][0], "", camera, 0.0, *tables_of_frame)
    is_alike = camera and not regions["frame"].any() and not grasps["frame"].any()
    return tables if is_alike else None


def _make_columns(file: h5py.File, sizes: Mapping[str, int]) -> None:
    """Make the datasets of a file, with the order and types of `NO_FRAMES`."""
    for group, columns in NO_FRAMES.items():
        made = file.create_group(group)
        for name, column in columns.items():
            rows = sizes.get(name, sizes[group]) + (name == "mask_start")
            shape = (rows, *column.shape[1:])
            make_column(made, name, shape, column.dtype, UNITS[group].get(name))


def _fill(file: h5py.File, tables: Tables, done: dict[str, int]) -> None:
    """Write `tables` after the `done` rows, and add their rows to `done`."""
    regions, grasps = tables["regions"], tables["grasps"]
    regions["frame"] += done["frames"]
    grasps["frame"] += done["frames"]
    grasps["region"] += done["regions"]
    regions["mask_start"] += done["mask_counts"]
    for group, columns in tables.items():
        for name, column in columns.items():
            first = done.get(name, done[group])
            file[group][name][first : first + len(column)] = column
    done["frames"] += len(tables["frames"]["name"])
    done["regions"] += len(regions["frame"])
    done["grasps"] += len(grasps["frame"])
    done["mask_counts"] += len(regions["mask_counts"])
