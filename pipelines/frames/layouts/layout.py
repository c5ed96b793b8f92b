"""A layout of RGB-D frames: its name, its files, and the function that finds frames in it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from pipelines.errors import printable
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.rgbd import Frame
from pipelines.storage.files import real_path


@dataclass(frozen=True)
class FoundFrame:
    """A frame that a layout finds in a folder."""

    stem: str  # name within the folder, with forward slashes; empty for a folder's only frame
    # Reads the frame, which has no name yet; raises a SymgraspError if it is faulty.
    read: Callable[[], Frame]
    files: tuple[Path | None, ...]  # the frame's existing files, colour first; None is left out
    layout: str = ""  # name of the layout, if it is not the layout that finds the frame
    is_whole: bool = True  # False for an image without its partner, which may be no frame at all


@dataclass(frozen=True)
class Layout:
    """One way to store RGB-D frames on disk."""

    name: str  # as in `symgrasp inspect` and formats.md
    # Called with a folder and the user's options; returns the folder's frames, none if the folder
    # has another layout. It may raise a SymgraspError if a folder of this layout is damaged.
    find: Callable[[Path, FrameOptions], Iterable[FoundFrame]]


def refuse(error: Exception) -> Frame:
    """Raise the fault of a frame, when the frame is read."""
    raise error


def frame_name(folder: Path, prefix: str, stem: str) -> str:
    """Return the name of a frame below the given folder; `stem` is empty for its only frame.

    Index files may name files anywhere; a frame's name never leaves the folder of results, and
    every file format can hold the name as text.
    """
    parts = [part for part in (*prefix.split("/"), *stem.split("/")) if part not in ("", ".", "..")]
    return printable("/".join(parts) or real_path(folder).name)
