"""The columns of many shards of `grasps.h5`, to be put together.

A shard that is just as `grasps_file.write` leaves it is read by HDF5's own handles, several times
faster than a frame. Any other is left to `grasps_file.read_shard`, which takes what can be taken,
or says what is wrong.
"""

from pathlib import Path

import h5py
from h5py import h5d

from pipelines.errors import SymgraspError
from pipelines.grasp_files.grasps_file import (
    FORMAT_VERSION,
    file_attributes,
    opened,
    read_shard,
    stored_intrinsics,
)
from pipelines.grasp_files.grasps_tables import (
    NO_FRAMES,
    FrameResult,
    GraspTable,
    RegionTable,
    Tables,
    tables_of,
)
from pipelines.storage.files import DAMAGED
from pipelines.storage.h5_columns import read_alike
from pipelines.storage.h5_files import open_h5

COUNTED = ("regions/frame", "grasps/frame", "regions/mask_counts")


def shard_sizes(path: Path) -> tuple[int, ...]:
    """Return how many regions, grasps and runs of masks a shard holds; the rest is not looked at.

    Raises:
        FormatError: the shard is damaged.
    """
    try:
        with open_h5(path) as file:
            return tuple(int(h5d.open(file.id, name.encode()).shape[0]) for name in COUNTED)
    except DAMAGED:
        with opened(path) as file:
            return tuple(len(file[name]) for name in COUNTED)


def shard_tables(path: Path) -> Tables:
    """Return the columns of one frame's shard, as `tables_of` gives them for that frame.

    Raises:
        FormatError: as `read_shard`.
    """
    try:
        with open_h5(path) as file:
            tables = _read(file)
    except (*DAMAGED, SymgraspError):
        tables = None
    return tables or tables_of([read_shard(path)])


def _read(file: h5py.File) -> Tables | None:
    """Return the columns of a shard of this version; None if something about them is otherwise.

    Raises:
        SymgraspError: they disagree.
    """
    attrs = file_attributes(file)  # all of them: what cannot be read is damaged
    if int(attrs["format_version"]) != FORMAT_VERSION:
        return None
    tables: Tables = {}
    for group, examples in NO_FRAMES.items():
        columns = read_alike(h5py.h5g.open(file.id, group.encode()), examples)
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
