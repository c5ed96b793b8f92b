"""A remark on frames below a folder that holds frames, which is not searched further down."""

import logging
import os
from collections.abc import Container, Iterator, Sequence
from itertools import islice
from pathlib import Path

from pipelines.frames.frame_names import last_part
from pipelines.frames.frame_options import NOTHING_STATED
from pipelines.frames.layouts import pcd
from pipelines.frames.layouts.registry import frames_in, holds_frame
from pipelines.frames.rgbd import FrameSource

log = logging.getLogger(__name__)

MOST_FOLDERS = 100  # that are looked into: a dataset has thousands, of labels and meshes
MOST_NAMED = 3


def warn_of_deeper_frames(frames: Path, sources: Sequence[FrameSource]) -> None:
    """Log the folders with frames that are not read, if `frames` is a folder.

    `sources`: all frames that were found in it.
    """
    if not frames.is_dir():
        return
    names = {last_part(source.name) for source in sources}
    unread = [
        folder
        for folder in islice(_others_below(frames, sources), MOST_FOLDERS)
        if _holds_frame(folder, names)
    ]
    if unread:
        named = ", ".join(map(str, unread[:MOST_NAMED]))
        more = f" and {len(unread) - MOST_NAMED} more folders" if len(unread) > MOST_NAMED else ""
        log.warning(
            "the frames in %s%s are not read, because a folder above holds frames; run the command "
            "on each of these folders too",
            named,
            more,
        )


def _holds_frame(folder: Path, names: Container[str]) -> bool:
    """Return whether `folder` holds other frames than clouds of the frames with `names`."""
    found = frames_in(folder, "", NOTHING_STATED)
    return holds_frame(
        each for each in found if each.layout != pcd.LAYOUT.name or each.name not in names
    )


def _others_below(frames: Path, sources: Sequence[FrameSource]) -> Iterator[Path]:
    """Yield folders below those of `sources` without a file of them; hidden ones are left out.

    An index may name images outside of `frames`, where nothing is searched.
    """
    root = os.path.abspath(frames)  # noqa: PTH100 - resolve no links
    held = [
        {os.path.abspath(path.parent) for path in each.files}  # noqa: PTH100
        for each in sources
        if each.files
    ]
    tops = {os.path.commonpath(folders) for folders in held}
    known = tops.union(*held)
    seen = set[str]()
    for top in sorted(top for top in tops if Path(top).is_relative_to(root)):
        for place, names, _files in os.walk(top):
            names[:] = [] if place in seen else sorted(n for n in names if not n.startswith("."))
            if place not in known and place not in seen:
                yield frames / os.path.relpath(place, root)
            seen.add(place)
