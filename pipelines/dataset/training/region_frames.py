"""Frames of a dataset with their visible symmetric regions, checked for consistency."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.dataset.graspnet.graspnet import FrameFiles, GraspNetRoot, SceneFiles
from pipelines.dataset.symmetry.regioned_objects import read_regioned_object
from pipelines.errors import FormatError
from pipelines.frames.rgbd import Frame
from pipelines.geometry.region_masks import RegionInstance, visible_regions

MAX_REGIONS = 255  # of one frame; the smallest are left out


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

    A frame with poses but without depth is included, so that reading it raises an error.
    """
    frame_ids = sorted({*scene.frame_ids, *scene.ids_of("annotations")})
    return [scene.frame(frame_id) for frame_id in frame_ids[::stride]]


def read_posed_label(
    root: GraspNetRoot, files: FrameFiles, shape: tuple[int, ...]
) -> tuple[NDArray[np.uint8 | np.uint16], dict[int, Array]]:
    """Read the label image of a frame and the poses of its objects.

    Args:
        root: the dataset.
        files: files of the frame.
        shape: (H, W) of its depth image.

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
        raise FormatError(
            files.path("label"),
            f"shows object {unknown[0] - 1}",
            f"{files.path('annotations').name} has no pose of it",
        )
    return label, poses


def _poses(root: GraspNetRoot, files: FrameFiles) -> dict[int, Array]:
    """Return the pose of each listed object, by object id."""
    poses = {pose.object_id: pose.T_cam_obj for pose in root.read_annotation(files)}
    missing = [i for i in root.scene(files.scene_id, files.camera).object_ids if i not in poses]
    if missing:
        raise FormatError(
            files.path("annotations"),
            f"holds no pose of object {missing[0]}",
            "object_id_list.txt names it",
        )
    return poses


def held_out_scenes(scenes: Sequence[str], fraction: float, seed: int) -> set[str]:
    """Return the validation scenes: `fraction` of all, at least one and not all; none for 0."""
    if fraction <= 0.0:
        return set()
    names = sorted(set(scenes))
    count = min(max(1, round(fraction * len(names))), len(names) - 1)
    return set(np.random.default_rng(seed).permutation(names)[: max(count, 0)].tolist())
