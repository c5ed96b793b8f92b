"""Training frames of the region detector: small, with the support plane and numbered regions."""

from collections.abc import Sequence

import numpy as np

from pipelines.array_types import Mask
from pipelines.configs import FinetuneDetectorConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.dataset.training.coco_instances import CocoFrame
from pipelines.dataset.training.detector_frames import DetectorFrame
from pipelines.dataset.training.region_frames import MAX_REGIONS, read_region_frame, strided_frames
from pipelines.errors import FormatError
from pipelines.frames.rgbd import Frame
from pipelines.tabletop.depth_channels import height_plane, shrink


def frames_of_scene(
    scene: SceneFiles, root: GraspNetRoot, config: FinetuneDetectorConfig
) -> list[DetectorFrame]:
    """Return the frames of a scene with the visible regions of its objects."""
    frames = []
    for files in strided_frames(scene, config.frame_stride):
        shown = read_region_frame(root, files, config.min_pixels)
        masks = [region.mask for region in shown.regions]
        frames.append(prepare_frame(shown.frame, masks, config))
    return frames


def frames_of_coco(
    listed: Sequence[CocoFrame], root: GraspNetRoot, config: FinetuneDetectorConfig
) -> list[DetectorFrame]:
    """Return frames of a COCO dataset with its annotated regions.

    Raises:
        FormatError: a mask and its frame differ in size.
    """
    frames = []
    for each in listed[:: config.frame_stride]:
        frame, masks = root.read_frame(each.files), each.masks()
        height, width = frame.depth.shape
        for mask in masks:
            if mask.shape != (height, width):
                found = f"its annotations have a mask of {mask.shape[1]}x{mask.shape[0]}"
                raise FormatError(each.files.path("rgb"), found, f"the image is {width}x{height}")
        masks = [mask for mask in masks if mask.sum() >= config.min_pixels]
        frames.append(prepare_frame(frame, masks[:MAX_REGIONS], config))
    return frames


def prepare_frame(
    frame: Frame, masks: Sequence[Mask], config: FinetuneDetectorConfig
) -> DetectorFrame:
    """Return a frame at the detector's size with its regions, numbered from 1."""
    detector = config.detector
    small = shrink(frame.color, frame.depth, frame.intrinsics, detector.min_size, detector.max_size)
    regions = np.zeros((frame.intrinsics.height, frame.intrinsics.width), np.uint8)
    for number, mask in enumerate(masks, start=1):
        regions[mask] = number
    sides = zip(small.depth.shape, regions.shape, strict=True)
    picked = [np.floor((np.arange(few) + 0.5) * many / few).astype(int) for few, many in sides]
    return DetectorFrame(small, height_plane(small), regions[np.ix_(*picked)])
