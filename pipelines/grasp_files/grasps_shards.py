"""The columns of many shards of `grasps.h5`, to be put together.

A shard that is just as `grasps_file.write` leaves it needs no tables to be made of it: its
columns are read, looked over and joined. Any other is left to `grasps_file.read_shard`, which
takes what can be taken, or says what is wrong.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
from h5py import h5d
from numpy.typing import NDArray

from pipelines.errors import ValueRangeError
from pipelines.grasp_files.grasps_file import (
    FORMAT_VERSION,
    file_attributes,
    opened,
    read_shard,
    stored_intrinsics,
)
from pipelines.grasp_files.grasps_tables import NO_FRAMES, STATUSES, Tables, tables_of
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
    except DAMAGED:
        tables = None
    return tables if tables and _is_of_one_frame(tables) else tables_of([read_shard(path)])


def _read(file: h5py.File) -> Tables | None:
    attrs = file_attributes(file)  # all of them: what cannot be read is damaged
    if int(attrs["format_version"]) != FORMAT_VERSION:
        return None
    tables: Tables = {}
    for group, examples in NO_FRAMES.items():
        columns = read_alike(h5py.h5g.open(file.id, group.encode()), examples)
        if columns is None:
            return None
        tables[group] = columns
    return tables


def _is_of_one_frame(tables: Mapping[str, Mapping[str, NDArray[Any]]]) -> bool:
    """Return whether all that the tables of a frame ask of their columns is so here."""
    frames, regions, grasps = (tables[group] for group in ("frames", "regions", "grasps"))
    num_regions, num_grasps = len(regions["box"]), len(grasps["width"])
    lengths = {**dict.fromkeys(regions, num_regions), "mask_start": num_regions + 1}
    lengths["mask_counts"] = len(regions["mask_counts"])
    if not (
        all(len(column) == 1 for column in frames.values())
        and all(len(regions[name]) == length for name, length in lengths.items())
        and all(len(column) == num_grasps for column in grasps.values())
    ):
        return False
    start = regions["mask_start"]
    return bool(
        frames["status"][0] in STATUSES
        and _is_camera(frames["size"][0], frames["intrinsics"][0])
        and start[0] == 0
        and start[-1] == len(regions["mask_counts"])
        and not regions["frame"].any()
        and not grasps["frame"].any()
        and (grasps["region"] >= 0).all()
        and (grasps["region"] < num_regions).all()
    )


def _is_camera(size: NDArray[Any], intrinsics: NDArray[Any]) -> bool:
    try:
        return stored_intrinsics(size, intrinsics) is not None
    except ValueRangeError:
        return False
