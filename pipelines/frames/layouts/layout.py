"""A layout of RGB-D frames: its name, its files, and the function that finds frames in it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipelines.errors import printable
from pipelines.frames.rgbd import FrameSource
from pipelines.frames.rgbd_folder import FrameOptions
from pipelines.storage.files import real_path

Find = Callable[[Path, str, FrameOptions], list[FrameSource]]


@dataclass(frozen=True)
class Layout:
    """One way to lay RGB-D frames on disk.

    Attributes:
        name: as `symgrasp inspect` and formats.md say it.
        find: called with a folder, the prefix of its frames' names, and what the user stated;
            returns its frames, none if the folder is not of this layout. It may raise a
            SymgraspError where the folder is of this layout but damaged.
    """

    name: str
    find: Find


def frame_name(folder: Path, prefix: str, stem: str) -> str:
    """Return the name of a frame below the folder given; `stem` is empty for a folder's only one.

    Index files may name files anywhere; a frame's name never leaves the folder of results, and
    every file can hold it as text.
    """
    parts = [part for part in (*prefix.split("/"), *stem.split("/")) if part not in ("", ".", "..")]
    return printable("/".join(parts) or real_path(folder).name)
