"""Reading and writing of `grasps.h5` a few frames at a time, with constant memory.

The tables of a file are sorted by frame, so bisection finds the rows of a frame and only these
rows are read. For writing, the rows of all parts are counted first, then filled in.
"""

import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5d, h5g

from pipelines.configs.inference import FRAME_PEERS
from pipelines.contents import mapping_in
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, SceneFiles, frame_key
from pipelines.errors import FormatError, SymgraspError
from pipelines.grasp_files.grasps_file import (
    FORMAT_VERSION,
    UNITS,
    file_attributes,
    opened,
    read_part,
    read_result,
    refuse_unordered,
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
from pipelines.storage.files import real_path
from pipelines.storage.h5_columns import json_attributes, make_column, read_alike, read_columns
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import Stamp

DEFAULT_GRIPPER = "rg2"
COUNTED = ("regions/frame", "grasps/frame", "regions/mask_counts")
BATCH = 64  # frames in memory while parts are put together


@dataclass(frozen=True)
class GraspsIndex:
    """The contents of a file without its grasps: names and statuses of frames, attributes."""

    names: list[str]
    statuses: list[str]  # ok, empty or failed, of each frame
    messages: list[str]  # why a frame is empty or has failed
    num_grasps: int  # of all frames together
    attrs: Mapping[str, Any]
    stamp: Mapping[str, Any]  # of the run that wrote the file, as JSON

    @property
    def gripper(self) -> str:
        """The gripper that the grasps were found for."""
        return str(self.attrs["config"].get("gripper", DEFAULT_GRIPPER))

    @property
    def knows_regions(self) -> bool:
        """Whether the method grasps regions; others find grasps anywhere in a frame."""
        return self.attrs["config"].get("method") not in FRAME_PEERS

    def dataset_names(self, path: Path) -> list[str]:
        """Return the names of all frames of the file at `path`, relative to the dataset's root.

        The frames of `infer ROOT/scenes/scene_0100` have shorter names; the recorded folder gives
        the missing part. Names that do not have GraspNet's layout stay.
        """
        folder = self.frames_folder(path).as_posix()
        return [_dataset_name(folder, name) for name in self.names]

    def frames_folder(self, path: Path) -> Path:
        """Return the folder that `infer` read the frames of the file at `path` from."""
        frames = mapping_in(self.stamp, "recorded").get("frames", "")
        return Path(os.path.normpath(real_path(path).parent / str(frames)))


def _dataset_name(folder: str, name: str) -> str:
    key = frame_key(f"{folder}/{name}")
    return name if key is None else FrameFiles(Path(), *key).name


def read_index(path: Path) -> GraspsIndex:
    """Read the names of all frames and the attributes.

    Raises:
        FormatError: the file is no grasps.h5, has another version, is truncated or inconsistent.
    """
    with opened(path) as file:
        columns = read_columns(path, file["frames"], ["name", "status", "message"])
        refuse_unordered(path, file)
        names, statuses, messages = ([str(text) for text in each] for each in columns.values())
        num_grasps = len(file["grasps/frame"])
        attrs = file_attributes(file)
        stamp = json_attributes(path, file, ("provenance",))["provenance"]
        return GraspsIndex(names, statuses, messages, num_grasps, attrs, stamp)


def read_results(path: Path, frames: Iterable[int]) -> Iterator[FrameResult]:
    """Yield the frames with the given indices in the file, one in memory at a time.

    Raises:
        FormatError: as in `read_index`.
    """
    with opened(path) as file:
        for frame in frames:
            yield read_result(path, file, frame)


def read_named(path: Path, name: str, place: int, config: Mapping[str, Any]) -> FrameResult:
    """Return the frame `name`, at the index `place` unless the file has been written again.

    `config`: settings of the run that wrote the file when `place` was found.

    Raises:
        SymgraspError: the file has been written again, with other settings or without the frame.
        FormatError: as in `read_index`.
    """
    with opened(path) as file:
        names = file["frames/name"].asstr()
        if place >= len(names) or names[place] != name:
            place = next(iter(np.flatnonzero(names[:] == name).tolist()), -1)
        if place < 0 or file_attributes(file)["config"] != config:
            change = f"without the frame {name!r}" if place < 0 else "with other settings"
            raise SymgraspError(f"{path} has been written again {change}; call read_grasps again")
        return read_result(path, file, place)


def read_dataset_frames(path: Path, frames: Iterable[int]) -> Iterator[FrameResult]:
    """Yield frames as in `read_results`, with the names of `GraspsIndex.dataset_names`."""
    frames = list(frames)
    names = read_index(path).dataset_names(path)
    for place, result in zip(frames, read_results(path, frames), strict=True):
        yield replace(result, name=names[place])


def places_by_scene(
    path: Path, index: GraspsIndex, root: GraspNetRoot
) -> dict[SceneFiles, list[int]]:
    """Return the places of the frames of each scene and camera, in the order of scene names.

    A frame that failed in `infer` and is not in the dataset, a stray picture, is left out.

    Raises:
        SymgraspError: `path` holds no frames, or frames that are not of the dataset.
    """
    scenes: dict[SceneFiles, list[int]] = defaultdict(list)
    for place, name in enumerate(index.dataset_names(path)):
        try:
            frame = root.frame(name)
        except SymgraspError as error:
            if index.statuses[place] == "failed":
                continue
            found = f"its frame {name} is not in {root.root}"
            raise FormatError(path, found, "give the dataset that infer was run on") from error
        scenes[root.scene(frame.scene_id, frame.camera)].append(place)
    if not scenes:
        raise FormatError(path, "holds no frames", "run infer on the dataset first")
    return {scene: scenes[scene] for scene in sorted(scenes, key=lambda scene: scene.name)}


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
