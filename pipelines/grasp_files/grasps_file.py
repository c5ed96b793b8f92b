"""`grasps.h5`: the results of `infer` on a batch of frames, one columnar file (formats.md).

During a run each frame has its own file, a part of the same layout, in `<grasps.h5>.parts/`;
after a killed run, the next run reads the parts and works only on the missing frames.
"""

import hashlib
import json
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import h5py
import numpy as np
from numpy.typing import NDArray

from pipelines.configs import InferConfig
from pipelines.contents import mapping_in
from pipelines.errors import FormatError, SymgraspError
from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files.grasps_tables import (
    REGION_MEASURED,
    SCHEMA,
    FrameResult,
    FrameTable,
    GraspTable,
    RegionTable,
    are_worth_trying,
    ranks_in_frame,
    tables_of,
)
from pipelines.storage.array_files import DAMAGED
from pipelines.storage.files import remove_folder
from pipelines.storage.h5_columns import (
    attribute,
    check_version,
    json_attributes,
    read_rows,
    write_attribute,
    write_columns,
)
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import Stamp

FORMAT_VERSION, OLDEST_VERSION = 6, 1
LONGEST_PART_NAME = 200  # characters of a part's file name; file systems take 255 bytes
AXES = "camera, OpenCV axes: x right, y down, z forward"
GRASP_FRAME = "columns approach, closing, approach x closing; origin midway between the contacts"
UNITS = {
    "frames": {"size": "pixel", "intrinsics": "pixel", "seconds": "s"},
    "regions": {"box": "pixel", "mask_counts": "pixel", "symmetry_point": "m"},
    "grasps": dict.fromkeys(
        ("translation", "width", "contacts", "clearance", "enclosed_height"), "m"
    ),
}
ADDED = {  # version to the columns that it added; before 2, `existence` was the confidence
    2: ("symmetry_confidence", "ranker"),
    3: ("rank_in_frame", "worth_trying"),
    4: ("status",),
    5: ("symmetry_source",),
    6: ("instance",),
}


def write(
    path: Path,
    results: Sequence[FrameResult],
    stamp: Stamp,
    weights: Mapping[str, str] | None = None,
) -> None:
    """Write `results` in order; the same results and stamp give the same bytes.

    `weights`: name to digest of the weights used; the stamp's inputs if not given.
    """
    with new_h5(path) as file:
        write_attributes(file, stamp, weights)
        for group, columns in tables_of(results).items():
            write_columns(file.create_group(group), columns, UNITS[group])


def write_attributes(
    file: h5py.File, stamp: Stamp, weights: Mapping[str, str] | None = None
) -> None:
    """Write the attributes of a run into the open `file`."""
    weights = stamp.inputs if weights is None else weights
    for name, value in (
        ("format_version", FORMAT_VERSION),
        ("axes", AXES),
        ("grasp_frame", GRASP_FRAME),
        ("config", json.dumps(dict(stamp.config), sort_keys=True)),
        ("weights", json.dumps(dict(weights), sort_keys=True)),
        ("seed", stamp.seed),
        ("provenance", stamp.as_text()),
    ):
        write_attribute(file.id, name, value)


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Yield the open file, checked; damage that HDF5 finds later is a FormatError too.

    Raises:
        FormatError: the file is no complete grasps.h5 of a known version.
    """
    try:
        with open_h5(path) as file:
            _check_file(path, file)
            yield file
    except DAMAGED as error:
        raise FormatError(path, f"is damaged ({error})", "run infer again") from error


def _check_file(path: Path, file: h5py.File) -> None:
    """Raise FormatError unless the open `file` has the groups and columns of its version."""
    check_version(path, attribute(file, "format_version"), FORMAT_VERSION, OLDEST_VERSION)
    missing = [group for group in SCHEMA if not isinstance(file.get(group), h5py.Group)]
    if missing:
        raise FormatError(path, f"has no group /{missing[0]}", "a grasps.h5 of infer is expected")
    for group, names in stored_columns(file).items():
        columns = {name: file[group].get(name) for name in names}
        lost = [name for name in names if not isinstance(columns[name], h5py.Dataset)]
        if lost:
            raise FormatError(path, f"has no dataset /{group}/{min(lost)}", "run infer again")
        rows = {len(column) for name, column in columns.items() if not name.startswith("mask_")}
        if len(rows) > 1:
            raise FormatError(path, f"columns of /{group} disagree", "run infer again")
    start, runs = file["regions/mask_start"], file["regions/mask_counts"]
    if len(start) != len(file["regions/frame"]) + 1 or start[0] != 0 or start[-1] != len(runs):
        raise FormatError(path, "the masks do not fill mask_counts", "run infer again")


def refuse_unordered(path: Path, file: h5py.File) -> None:
    """Raise FormatError unless the rows of the open `file` are in the order of its frames.

    Rows are found by bisection, which would lose others without a word.
    """
    count = len(file["frames/name"])
    for name in ("regions/frame", "grasps/frame"):
        frame = read_rows(file[name], slice(None))
        if len(frame) and not (frame[0] >= 0 and frame[-1] < count):
            found = f"/{name} is {frame[0]} to {frame[-1]}, but the file has {count} frames"
            raise FormatError(path, found, "run infer again")
        if (frame[1:] < frame[:-1]).any():
            raise FormatError(path, f"/{name} does not ascend", "sort the rows by frame")


def stored_columns(file: h5py.File) -> dict[str, list[str]]:
    """Return the names of the columns in a file of this version, by group."""
    version = int(attribute(file, "format_version"))
    missing = [name for since, names in ADDED.items() if since > version for name in names]
    columns = {group: [n for n in names if n not in missing] for group, names in SCHEMA.items()}
    return columns | {"frames": list(FrameTable.SPEC)}  # all versions have `status` of frames


def complete_columns(regions: dict[str, Any], grasps: dict[str, Any], file: h5py.File) -> None:
    """Add the columns that older versions lack, from the attributes of the open `file`."""
    regions.setdefault("status", np.full(len(regions["box"]), REGION_MEASURED, object))
    regions.setdefault("instance", np.full(len(regions["box"]), -1))
    grasps.setdefault("symmetry_source", np.full(len(grasps["width"]), "", object))
    if "symmetry_confidence" not in regions:
        regions["symmetry_confidence"] = regions["existence"]
        regions["existence"] = np.full_like(regions["existence"], np.nan)
    if "ranker" not in grasps:
        config = file_attributes(file)["config"]
        is_critic = mapping_in(config, "selection").get("rank_by") in ("critic", "judge")
        ranker = "critic" if is_critic and config.get("method") == "network" else "eq8"
        grasps["ranker"] = np.full(len(grasps["width"]), ranker, object)
    if "rank_in_frame" not in grasps:
        score = grasps["rank_score"]
        grasps["rank_in_frame"] = ranks_in_frame(grasps["frame"], score)
        least = InferConfig.weak_below
        grasps["worth_trying"] = are_worth_trying(grasps["ranker"], score, least)


def file_attributes(file: h5py.File) -> dict[str, Any]:
    """Return the attributes of an open file, `config` and `weights` as JSON objects.

    Raises:
        FormatError: one of the two is no JSON object.
    """
    path = Path(file.filename)
    found = {name: attribute(file, name) for name in file.attrs}
    return found | json_attributes(path, file, ("config", "weights"))


def stored_intrinsics(size: NDArray[Any], intrinsics: NDArray[Any]) -> Intrinsics | None:
    """Return the camera of a row of `/frames`; None if the frame could not be read."""
    width, height = size.tolist()
    if width == 0:
        return None
    fx, fy, cx, cy = intrinsics.tolist()
    return Intrinsics(fx, fy, cx, cy, width, height)


def parts_folder(path: Path) -> Path:
    """Return the folder of the parts of the file `path`."""
    return path.with_name(f"{path.name}.parts")


def part_path(path: Path, frame_name: str) -> Path:
    """Return the path of a frame's part of the output `path`."""
    safe = quote(frame_name, safe="")
    if len(safe) > LONGEST_PART_NAME:
        safe = safe[-LONGEST_PART_NAME:] + hashlib.sha256(frame_name.encode()).hexdigest()[:16]
    return parts_folder(path) / f"{safe}.h5"


def read_part(path: Path) -> FrameResult:
    """Read the result of one frame from its part.

    Raises:
        FormatError: the file does not hold exactly one frame, or is damaged.
    """
    with opened(path) as file:
        file_attributes(file)
        if (count := len(file["frames/name"])) != 1:
            raise FormatError(path, f"holds {count} frames", "a part holds one")
        return read_result(path, file, 0)


def read_result(path: Path, file: h5py.File, frame: int) -> FrameResult:
    """Read the frame with the index `frame` of the open file `path`.

    Raises:
        FormatError: the rows of the frame are damaged, or disagree.
    """
    try:
        return _read_frame(file, frame)
    except (*DAMAGED, SymgraspError) as error:
        found = f"frame {frame} is damaged ({error})"
        raise FormatError(path, found, "run infer again") from error


def _read_frame(file: h5py.File, frame: int) -> FrameResult:
    table = file["frames"]
    first, last = rows_of_frame(file["regions/frame"], frame)
    start, end = rows_of_frame(file["grasps/frame"], frame)
    stored = stored_columns(file)
    names = (name for name in RegionTable.SPEC if name in stored["regions"])
    regions = _slice(file["regions"], names, first, last)
    mask_start = file["regions/mask_start"][first : last + 1].astype(np.int64)
    regions["mask_counts"] = file["regions/mask_counts"][mask_start[0] : mask_start[-1]]
    regions["mask_start"] = mask_start - mask_start[0]
    grasps = _slice(file["grasps"], stored["grasps"], start, end)
    complete_columns(regions, grasps, file)
    local = GraspTable(**grasps)
    return FrameResult(
        name=table["name"].asstr()[frame],
        status=table["status"].asstr()[frame],
        message=table["message"].asstr()[frame],
        intrinsics=stored_intrinsics(table["size"][frame], table["intrinsics"][frame]),
        seconds=float(table["seconds"][frame]),
        regions=replace(RegionTable(**regions), frame=np.zeros(last - first)),
        grasps=replace(local, frame=np.zeros(end - start), region=local.region - first),
    )


def rows_of_frame(frame_of_row: h5py.Dataset, frame: int) -> tuple[int, int]:
    """Return the first row of the frame with the index `frame`, and the row after its last."""
    first = bisect_left(frame_of_row, frame)
    return first, bisect_left(frame_of_row, frame + 1, lo=first)


def _slice(group: h5py.Group, names: Iterable[str], start: int, end: int) -> dict[str, Any]:
    return {name: read_rows(group[name], slice(start, end)) for name in names}


def remove_parts(path: Path) -> None:
    """Remove the parts of the output `path`; a link to a folder on another disk stays."""
    folder = parts_folder(path)
    if folder.is_dir():
        remove_folder(folder, "*.h5")
