"""Reading of `grasps.h5` a frame at a time, with constant memory.

The tables of a file are sorted by frame, so bisection finds the rows of a frame and only these
rows are read.
"""

import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipelines.configs.inference import FRAME_PEERS
from pipelines.contents import mapping_in
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, SceneFiles, frame_key
from pipelines.errors import FormatError, SymgraspError
from pipelines.grasp_files.grasps_file import (
    file_attributes,
    opened,
    read_result,
    refuse_unordered,
    rows_of_frame,
)
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.storage.files import real_path
from pipelines.storage.h5_columns import json_attributes, read_columns

DEFAULT_GRIPPER = "rg2"


class StoredFrame(NamedTuple):
    """A frame of a file, with its index and that of its first grasp in /grasps."""

    place: int
    first_grasp: int
    result: FrameResult


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
        FormatError: the file is no grasps.h5, has another version, is truncated or inconsistent, or
            has two frames of one name.
    """
    with opened(path) as file:
        columns = read_columns(path, file["frames"], ["name", "status", "message"])
        refuse_unordered(path, file)
        names, statuses, messages = ([str(text) for text in each] for each in columns.values())
        name, count = next(iter(Counter(names).most_common(1)), ("", 0))
        if count > 1:  # outputs by name would replace each other
            raise FormatError(path, f"has {count} frames named {name!r}", "give each its own name")
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


def read_sound(path: Path, names: Sequence[str], damaged: dict[str, str]) -> Iterator[StoredFrame]:
    """Yield the frames that can be read, one in memory at a time; note the others in `damaged`.

    Args:
        path: the file.
        names: of all its frames.
        damaged: name of a frame to the sentence on its damage; filled here.

    Raises:
        FormatError: as in `read_index`.
    """
    with opened(path) as file:
        for place, name in enumerate(names):
            try:
                first_grasp, _ = rows_of_frame(file["grasps/frame"], place)
                result = read_result(path, file, place)
            except SymgraspError as error:
                damaged[name] = str(error)
                continue
            yield StoredFrame(place, first_grasp, result)


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
