"""Find RGB-D frames below a folder, whatever its layout."""

import re
from collections.abc import Callable, Container
from functools import partial
from pathlib import Path

from pipelines.errors import SymgraspError
from pipelines.frames.graspnet_scene import CAMERAS
from pipelines.frames.layouts.registry import frames_in, pickled_in
from pipelines.frames.rgbd import FrameSource
from pipelines.frames.rgbd_folder import NOTHING_STATED, FrameOptions
from pipelines.frames.unread_files import why_no_frames
from pipelines.storage.files import real_path
from pipelines.storage.unfinished import refuse_unfinished

SCENE_FOLDER = re.compile(r"scene_(\d{4})")  # of GraspNet


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
    down; a folder that holds none is searched folder by folder. Images are not read yet:
    `FrameSource.read` reads them, and raises their faults.

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
        sources = [found for found in _beside(folder, stated) if folder in found.files]
        if not sources:
            raise SymgraspError(f"{folder} is not a folder; give the folder that holds the frames")
        return sources
    refuse_unfinished(folder)
    sources = _search(folder, "", stated, partial(_is_wanted, camera, scenes))
    if not sources and not may_be_empty:
        raise SymgraspError(why_no_frames(folder))
    if (camera or scenes) and sources and not any(map(_is_of_a_scene, sources)):
        raise SymgraspError(
            f"{folder} holds no GraspNet scenes (scene_NNNN); leave out --split and --camera"
        )
    return sources


def _beside(file: Path, options: FrameOptions) -> list[FrameSource]:
    """List the frames of the file's folder, and of the folder above: images may be in `rgb/`."""
    if not file.is_file():
        return []
    folders = (file.parent, file.parent.parent)
    found = [source for folder in folders for source in frames_in(folder, "", options)]
    return found + pickled_in(file.parent, "", options)


def _is_wanted(camera: str | None, scenes: Container[int] | None, folder: str) -> bool:
    """Return whether a folder of a GraspNet root is wanted; all other folders are."""
    if folder in CAMERAS:
        return camera in (None, folder)
    scene = SCENE_FOLDER.fullmatch(folder)
    return scene is None or scenes is None or int(scene[1]) in scenes


def _is_of_a_scene(source: FrameSource) -> bool:
    return any(map(SCENE_FOLDER.fullmatch, source.files[0].absolute().parts))


def _search(
    folder: Path, prefix: str, options: FrameOptions, is_wanted: Callable[[str], bool]
) -> list[FrameSource]:
    if not is_wanted(folder.name):
        return []
    direct = frames_in(folder, prefix, options)
    if direct:
        return direct
    # In a GraspNet root only the scenes hold frames; models/ is large.
    below = [folder / "scenes"] if (folder / "scenes").is_dir() else sorted(folder.iterdir())
    sources = []
    for child in below:
        if child.is_symlink() and real_path(folder).is_relative_to(real_path(child)):
            continue  # a link to a folder above would be searched for ever
        if child.is_dir() and not child.name.startswith("."):
            name = f"{prefix}/{child.name}" if prefix else child.name
            sources += _search(child, name, options, is_wanted)
    return sources or pickled_in(folder, prefix, options)
