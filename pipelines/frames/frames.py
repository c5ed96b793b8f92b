"""Find RGB-D frames below a folder, whatever its layout."""

import logging
import os
import re
from collections.abc import Callable, Container
from functools import partial
from pathlib import Path

from pipelines.errors import SymgraspError
from pipelines.frames.frame_options import NOTHING_STATED, FrameOptions
from pipelines.frames.graspnet_scene import CAMERAS
from pipelines.frames.layouts.registry import frames_in, holds_frame, pickled_in
from pipelines.frames.pairing.unread_files import why_no_frame, why_no_frames
from pipelines.frames.rgbd import FrameSource
from pipelines.storage.files import is_file, real_path
from pipelines.storage.unfinished import refuse_unfinished

log = logging.getLogger(__name__)

SCENE_FOLDER = re.compile(r"scene_(\d{4})")  # of GraspNet
NOT_CHOSEN = "holds no RGB-D frames of this --split and --camera; name others or leave them out"


def find_frames(
    folder: Path,
    stated: FrameOptions = NOTHING_STATED,
    *,
    camera: str | None = None,
    scenes: Container[int] | None = None,
    may_be_empty: bool = False,
) -> list[FrameSource]:
    """List the RGB-D frames of `folder`, sorted by folder and name.

    Layouts are distinguished by their files. A folder that holds frames is not searched further
    down; a folder that holds none is searched folder by folder, and its images without a partner
    are listed only if nothing else is found. Images are not read yet: `FrameSource.read` reads
    them, and raises their faults.

    Args:
        folder: folder to search, or one file of a frame (an image, `.npz`, `.pcd`).
        stated: camera and unit of all frames, in place of the ones in the files next to the images;
            whether to read arrays from pickles too, with `plain_pickle`.
        camera: in GraspNet scenes only this camera, `kinect` or `realsense`; all if None.
        scenes: in GraspNet roots only the scenes of these numbers; all if None.
        may_be_empty: a folder without frames gives an empty list, no error.

    Raises:
        SymgraspError: no such folder, no frames in it, a dataset that is unfinished, or a camera
            or scenes chosen in a folder without GraspNet scenes.
    """
    if not folder.is_dir():
        sources = _with_file(folder, stated)
        if not sources:
            raise SymgraspError(why_no_frame(folder))
        return sources
    next(folder.iterdir(), None)  # raises the error of a folder that may not be read
    refuse_unfinished(folder)
    sources = _search(folder, "", stated, partial(_is_wanted, camera, scenes))
    is_chosen = camera is not None or scenes is not None
    if not sources and not may_be_empty:
        raise SymgraspError(f"{folder} {NOT_CHOSEN}" if is_chosen else why_no_frames(folder))
    if is_chosen and sources and not any(_is_of_a_scene(folder, each) for each in sources):
        raise SymgraspError(
            f"{folder} holds no GraspNet scenes (scene_NNNN); leave out --split and --camera"
        )
    return sources


def _with_file(file: Path, options: FrameOptions) -> list[FrameSource]:
    """List the frames that `file` is part of; its folder is searched first, then that above.

    Images may be in `rgb/`, whose frames are those of the folder above. A folder with a fault, such
    as a damaged index, gives a source without files, which raises the fault.
    """
    if not is_file(file):
        return []
    # Path.parent of "x.png" is its own parent, and that of ".." is ".".
    file = Path(os.path.abspath(file))  # noqa: PTH100 - Path.absolute keeps "..", resolve no links
    searches = (
        partial(frames_in, file.parent),
        partial(frames_in, file.parent.parent),
        partial(pickled_in, file.parent),
    )
    alone: list[FrameSource] = []
    for search in searches:
        found = search("", options)
        found = [each for each in found if file in each.files or not each.files]
        if holds_frame(found):
            return found
        alone = alone or found
    return alone


def _is_wanted(camera: str | None, scenes: Container[int] | None, folder: str) -> bool:
    """Return whether a folder of a GraspNet root is wanted; all other folders are."""
    if folder in CAMERAS:
        return camera in (None, folder)
    scene = SCENE_FOLDER.fullmatch(folder)
    return scene is None or scenes is None or int(scene[1]) in scenes


def _is_of_a_scene(folder: Path, source: FrameSource) -> bool:
    """Return whether a frame found in `folder` is in a scene; a damaged index has no files."""
    parts = (*folder.absolute().parts, *source.name.split("/"))
    return any(map(SCENE_FOLDER.fullmatch, parts))


def _search(
    folder: Path,
    prefix: str,
    options: FrameOptions,
    is_wanted: Callable[[str], bool],
    way: tuple[Path, ...] = (),
) -> list[FrameSource]:
    """List the frames of `folder` and below; `way`: real paths of the folders that led to it."""
    if not is_wanted(folder.name):
        return []
    if way and not os.access(folder, os.R_OK | os.X_OK):  # another user's, as a disk's lost+found
        log.warning("%s is not searched for frames: you may not read it", folder)
        return []
    direct = frames_in(folder, prefix, options)
    if holds_frame(direct):
        return direct
    sources, way = list[FrameSource](), (*way, real_path(folder))
    for child in _below(folder):
        if child.is_symlink() and any(step.is_relative_to(real_path(child)) for step in way):
            continue  # a link back to a folder on the way would be searched again and again
        if child.is_dir() and not child.name.startswith("."):
            name = f"{prefix}/{child.name}" if prefix else child.name
            sources += _search(child, name, options, is_wanted, way)
    if holds_frame(sources):
        return sources
    return pickled_in(folder, prefix, options) or direct or sources


def _below(folder: Path) -> list[Path]:
    """Return what to search below `folder`: of a GraspNet root the scenes, as models/ is large."""
    scenes = folder / "scenes"
    is_root = scenes.is_dir() and any(
        SCENE_FOLDER.fullmatch(each.name) for each in scenes.iterdir()
    )
    return [scenes] if is_root else sorted(folder.iterdir())
