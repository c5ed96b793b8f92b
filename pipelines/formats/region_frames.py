"""A dataset's frames with the symmetric regions that they show, as the detector learns them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.formats.graspnet import FrameFiles, GraspNetRoot
from pipelines.formats.regioned_objects import read_regioned_object
from pipelines.formats.rgbd import Frame
from pipelines.geometry.region_masks import RegionInstance, visible_regions

MOST_REGIONS = 255  # of one frame; the rest, the smallest, are left out


@dataclass(frozen=True)
class RegionFrame:
    """A frame at its full size and its regions, the largest first."""

    frame: Frame
    regions: tuple[RegionInstance, ...]


def read_region_frame(root: GraspNetRoot, files: FrameFiles, min_pixels: int) -> RegionFrame:
    """Read a frame and find the regions that show in at least `min_pixels` of it."""
    frame = root.read_frame(files)
    poses = [(pose.object_id, pose.T_cam_obj) for pose in root.read_annotation(files)]
    objects = {object_id: read_regioned_object(root.root, object_id) for object_id, _ in poses}
    shown = visible_regions(root.read_label(files), frame.intrinsics, poses, objects)
    shown = [each for each in shown if each.mask.sum() >= min_pixels]
    shown = sorted(shown, key=lambda each: -int(each.mask.sum()))[:MOST_REGIONS]
    return RegionFrame(frame, tuple(shown))


def held_out_scenes(scenes: Sequence[str], fraction: float, seed: int) -> set[str]:
    """Return the scenes to validate on: `fraction` of them, at least one, never all of them."""
    names = sorted(set(scenes))
    count = min(max(1, round(fraction * len(names))), len(names) - 1)
    return set(np.random.default_rng(seed).permutation(names)[: max(count, 0)].tolist())
