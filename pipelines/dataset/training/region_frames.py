"""Frames of a dataset with their visible symmetric regions, checked for consistency."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles, SceneFiles
from pipelines.dataset.symmetry.regioned_objects import read_regioned_object
from pipelines.errors import FormatError, ValueRangeError
from pipelines.frames.rgbd import Frame
from pipelines.geometry.region_masks import RegionInstance, visible_regions

MAX_REGIONS = 255  # of one frame; the smallest are left out
SCENE = len("scene_0000")
FileRows = Sequence[tuple[Path, int]]  # file and row of each frame


@dataclass(frozen=True)
class FrameSets:
    """Frames to train on and frames of other scenes to validate on."""

    train: FileRows
    val: FileRows


@dataclass(frozen=True)
class RegionFrame:
    """A frame at full size and its regions, the largest first."""

    frame: Frame
    regions: tuple[RegionInstance, ...]


def read_region_frame(root: GraspNetRoot, files: FrameFiles, min_pixels: int) -> RegionFrame:
    """Read a frame and its regions with at least `min_pixels` visible pixels."""
    frame = root.read_frame(files)
    label, poses = read_posed_label(root, files, frame.depth.shape)
    objects = {object_id: read_regioned_object(root.root, object_id) for object_id in poses}
    shown = visible_regions(label, frame.intrinsics, list(poses.items()), objects)
    shown = [each for each in shown if each.mask.sum() >= min_pixels]
    shown = sorted(shown, key=lambda each: -int(each.mask.sum()))[:MAX_REGIONS]
    return RegionFrame(frame, tuple(shown))


def strided_frames(scene: SceneFiles, stride: int) -> list[FrameFiles]:
    """Return every `stride`-th frame of a scene.

    Frames with poses but without any image are left out, unless the scene has no other. A frame
    that lacks only its depth is included, so that reading it raises an error.
    """
    frame_ids = scene.image_ids or scene.ids_of("annotations")
    return [scene.frame(frame_id) for frame_id in frame_ids[::stride]]


def read_posed_label(
    root: GraspNetRoot, files: FrameFiles, shape: tuple[int, ...]
) -> tuple[NDArray[np.uint8 | np.uint16], dict[int, Array]]:
    """Read the label image of a frame and the poses of its objects.

    `shape`: size (H, W) of the depth image.

    Returns:
        The label (H, W), object id + 1, 0 = background; T_cam_obj (4, 4) by object id.

    Raises:
        FormatError: the label has another size, or an object of the label or of the scene's list
            has no pose.
    """
    label, poses = root.read_label(files), _poses(root, files)
    if label.shape != shape:
        found = f"the label image is {label.shape[1]}x{label.shape[0]}"
        expected = f"the depth image is {shape[1]}x{shape[0]}"
        raise FormatError(files.path("label"), found, expected)
    unknown = sorted(set(np.unique(label).tolist()) - {i + 1 for i in poses} - {0})
    if unknown:
        expected = f"{files.path('annotations').name} has no pose of this object"
        raise FormatError(files.path("label"), f"shows object {unknown[0] - 1}", expected)
    return label, poses


def _poses(root: GraspNetRoot, files: FrameFiles) -> dict[int, Array]:
    """Return the pose of each listed object, by object id."""
    poses = {pose.object_id: pose.T_cam_obj for pose in root.read_annotation(files)}
    missing = [i for i in root.scene(files.scene_id, files.camera).object_ids if i not in poses]
    if missing:
        found = f"holds no pose of object {missing[0]}"
        raise FormatError(files.path("annotations"), found, "object_id_list.txt names it")
    return poses


def split_frames(
    files: Iterable[Path],
    count: Callable[[Path], int],
    fraction: float,
    seed: int,
    held_out: set[str] | None = None,
) -> FrameSets:
    """Return the frames of most scenes for training, and of the other scenes for validation.

    `files`: one per scene and camera, `scene_NNNN_CAMERA.h5`. `fraction` of the scenes is drawn for
    validation, unless `held_out` lists these scenes.

    Raises:
        ValueRangeError: there is only one scene, no frame to train on, or none to validate on.
    """
    files = sorted(files)
    scenes = {path.stem[:SCENE] for path in files}
    if len(scenes) < 2:
        where = "number of scenes" + (f" in {files[0].parent}" if files else "")
        raise ValueRangeError(where, len(scenes), "at least 2, one to validate on")
    if held_out is None:
        held_out = held_out_scenes(sorted(scenes), fraction, seed)
    train: list[tuple[Path, int]] = []
    val: list[tuple[Path, int]] = []
    for path in files:
        rows = val if path.stem[:SCENE] in held_out else train
        rows.extend((path, row) for row in range(count(path)))
    for of_what, rows in (("to train on", train), ("to validate on", val)):
        if not rows:
            where = f"number of frames {of_what} in {files[0].parent}"
            raise ValueRangeError(where, 0, "at least 1")
    return FrameSets(train, val)


def held_out_scenes(scenes: Sequence[str], fraction: float, seed: int) -> set[str]:
    """Return the validation scenes: `fraction` of all, at least one and not all; none for 0."""
    if fraction <= 0.0:
        return set()
    names = sorted(set(scenes))
    count = min(max(1, round(fraction * len(names))), len(names) - 1)
    return set(np.random.default_rng(seed).permutation(names)[: max(count, 0)].tolist())
