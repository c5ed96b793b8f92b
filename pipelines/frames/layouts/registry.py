"""All layouts of RGB-D frames, most specific first: the first layout that finds frames counts.

Images without their partner count only if no layout finds a whole frame: pictures of other kinds
have such names too.
"""

import functools
import itertools
from collections.abc import Callable, Container, Iterable
from dataclasses import replace
from pathlib import Path

from pipelines.errors import SymgraspError
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts import (
    arkit,
    arrays,
    blenderproc,
    bop,
    nerfstudio,
    paired,
    pcd,
    rosbag,
    scannet,
    tum,
)
from pipelines.frames.layouts.layout import FoundFrame, Layout, frame_name, refuse
from pipelines.frames.layouts.paired import Pairing
from pipelines.frames.rgbd import Frame, FrameSource

LAYOUTS: tuple[Layout | Pairing, ...] = (
    paired.GRASPNET_SCENE,
    paired.GRASPNET_DEMO,
    bop.LAYOUT,
    paired.BOP_IMAGE,
    paired.RECORDER,
    paired.YCB_VIDEO,
    paired.PRINCETON,
    scannet.LAYOUT,
    tum.LAYOUT,
    nerfstudio.LAYOUT,
    arkit.LAYOUT,
    paired.FOUNDATION_POSE,
    paired.REPLICA,
    paired.GQCNN,
    arrays.LAYOUT,
    blenderproc.LAYOUT,
    paired.FLAT,
    paired.SISTERS,
    pcd.LAYOUT,
    rosbag.LAYOUT,  # last: images extracted from a bag are often next to it
)
# Used if neither a folder nor those below it hold frames: a stray pickle must not hide frames.
LAST_RESORT = arrays.PICKLED


def frames_in(folder: Path, prefix: str, options: FrameOptions) -> list[FrameSource]:
    """List the frames directly in `folder`, empty if there are none; `holds_frame` if one is whole.

    A folder with a damaged index gives one source, which raises the fault.
    """
    alone: list[FrameSource] = []
    for layout in LAYOUTS:
        found = _found(layout, folder, prefix, options)
        if holds_frame(found):
            return found
        alone = alone or found
    return alone


def holds_frame(sources: Iterable[FrameSource]) -> bool:
    """Return whether one of `sources` is more than an image without its partner."""
    return any(source.is_whole for source in sources)


def pickled_in(folder: Path, prefix: str, options: FrameOptions) -> list[FrameSource]:
    """List the pickles in `folder`; reading one raises unless pickles are trusted."""
    return _found(LAST_RESORT, folder, prefix, options)


def _found(
    layout: Layout | Pairing, folder: Path, prefix: str, options: FrameOptions
) -> list[FrameSource]:
    try:
        found = list(layout.find(folder, options))
    except (SymgraspError, OSError) as error:
        found = [FoundFrame("", functools.partial(refuse, error), ())]
    sources, taken = [], set[str]()
    for each in found:
        files = tuple(path for path in each.files if path is not None)
        # Hidden files, which other systems leave next to their files, are skipped.
        if not any(path.name.startswith(".") for path in files):
            name = _unused(frame_name(folder, prefix, each.stem), taken)
            taken.add(name)
            read = functools.partial(_named, name, each.read)
            found_in = each.layout or layout.name
            sources.append(FrameSource(name, read, files, found_in, each.is_whole))
    return sources


def _unused(name: str, taken: Container[str]) -> str:
    """Return `name`, with a number if it is `taken`: frames of one name would be one result."""
    numbered = (f"{name}-{number}" for number in itertools.count(2))
    return next(each for each in itertools.chain([name], numbered) if each not in taken)


def _named(name: str, read: Callable[[], Frame]) -> Frame:
    return replace(read(), name=name)
