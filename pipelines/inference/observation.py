"""The observation of one frame, from which every method plans grasps.

Sparse depth is filled, the support plane and the regions are found, and each region is turned into
points. `infer`, the compared baselines and the training of the critics all start from the same
points of the same regions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask, Singles
from pipelines.configs import ColorConfig, InferConfig
from pipelines.errors import counted
from pipelines.frames.rgbd import Frame
from pipelines.geometry.transforms import transform_points
from pipelines.grasp_files.grasps_tables import REGION_FLAT, REGION_MEASURED, REGION_NO_DEPTH
from pipelines.grasping.limits import Limits
from pipelines.grasping.planner import MIN_POINTS
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.inference.regions.rated_regions import rated_by_detector
from pipelines.inference.regions.regions import Region, find_regions, with_containers_joined
from pipelines.inference.regions.regions_by_color import with_color
from pipelines.tabletop.regions.color import ColorPieces, color_pieces
from pipelines.tabletop.regions.object_criteria import top_height
from pipelines.tabletop.regions_geometric import (
    GeometricRegions,
    enlarged,
    geometric_regions,
    least_pixels,
    working_scale,
    working_step,
)
from pipelines.tabletop.sparse_depth import filled

if TYPE_CHECKING:
    from pipelines.network.detection.detector import ExaminedFrame, RegionDetector

MIN_MEASURED = 0.1  # smallest share of pixels with depth of a region that counts as measured


@dataclass(frozen=True)
class Observation:
    """The observation of one frame; camera frame, metres.

    Attributes:
        color: (H, W, 3) RGB.
        scene: depth without the holes of sparse sensors, support plane, limits of grasps.
        segments: the parts of the foreground that the depth alone separates.
        regions: in the order of detection.
        clouds: the points of each of `regions`.
        min_region_pixels: least number of pixels of a region at the size of this image.
        too_small: number of further regions with fewer than `min_region_pixels`.
        improbable: number of further regions with a rating below `min_rating`.
    """

    color: NDArray[np.uint8]
    scene: SceneCloud
    segments: GeometricRegions
    regions: list[Region]
    clouds: list[RegionCloud]
    min_region_pixels: int
    too_small: int = 0
    improbable: int = 0

    def in_workspace(self) -> tuple[list[Region], list[RegionCloud]]:
        """Return the regions with a point in the workspace, and their points."""
        limits = self.scene.limits
        if limits is None:
            return self.regions, self.clouds
        inside = [bool(limits.contain(cloud.points).any()) for cloud in self.clouds]
        return list(compress(self.regions, inside)), list(compress(self.clouds, inside))


def observe(
    frame: Frame,
    config: InferConfig,
    rng: np.random.Generator,
    *,
    detector: "RegionDetector | None" = None,
    masks: NDArray[np.int32] | None = None,
    workspace: Mask | None = None,
    regions: Sequence[Mask] | None = None,
) -> Observation:
    """Return the support plane, the regions and the points of `frame`.

    Args:
        frame: colour and depth, 0 where missing.
        config: settings for finding regions, and limits of grasps.
        rng: for the search of the support plane.
        detector: of regions; None for regions by depth alone.
        masks: (H, W) instance ids of the user, 0 = background, instead of found regions.
        workspace: (H, W) pixels where grasps are allowed; None for everywhere.
        regions: masks (H, W) from another run, instead of found regions.

    Raises:
        ValueRangeError: `config.limits` are in the table frame, and no table is found.
    """
    depth, intrinsics = filled(frame.depth), frame.intrinsics
    least = least_pixels(config.min_region_pixels, depth.shape)
    config = replace(config, min_region_pixels=least)
    # The user's instances are no support: a plane needs depth outside of the instances.
    ground = None if masks is None else masks == 0
    segments = geometric_regions(depth, intrinsics, config.region, rng, ground)
    limits = Limits.of(config.limits, workspace, segments.plane, intrinsics)
    scene = SceneCloud(depth.astype(np.float64), intrinsics, segments.plane, limits, config.sensor)
    too_small = improbable = 0
    if regions is not None:
        found = [Region(mask, 1.0, "masks") for mask in regions]
    elif masks is not None:
        found, too_small = find_regions(depth, segments, config, (), masks)
    else:
        examined = None
        if detector is not None:
            examined = detector.examine(frame.color, depth, intrinsics, segments.plane)
        every, too_small = _shown_regions(frame, depth, segments, examined, config)
        found = every if examined is None else rated_by_detector(every, examined, config)
        improbable = len(every) - len(found)
    clouds = [RegionCloud.from_mask(region.mask, scene) for region in found]
    found = [
        replace(region, status=_status(cloud, segments))
        for region, cloud in zip(found, clouds, strict=True)
    ]
    return Observation(frame.color, scene, segments, found, clouds, least, too_small, improbable)


def _shown_regions(
    frame: Frame,
    depth: Singles,
    segments: GeometricRegions,
    examined: "ExaminedFrame | None",
    config: InferConfig,
) -> tuple[list[Region], int]:
    """Return the regions that detector, depth and colour show, and the number of too small ones."""
    detections = () if examined is None else examined.detections
    found, too_small = find_regions(depth, segments, config, detections, None)
    if config.regions == "auto" and config.region.color.is_used:
        pieces = _color_pieces(frame.color, segments, config.region.color)
        found = with_color(found, pieces, segments, depth, frame.intrinsics, config)
    if config.regions != "detector":
        found = with_containers_joined(found, segments)
    return found, too_small


def _color_pieces(
    color: NDArray[np.uint8], segments: GeometricRegions, config: ColorConfig
) -> ColorPieces:
    """Return the pieces of uniform colour in `color` (H, W, 3), found at the working size."""
    step = working_step(segments.bare.shape)
    bare = segments.bare[::step, ::step]
    config = replace(
        config,
        min_pixels=least_pixels(config.min_pixels, bare.shape),
        min_thickness=config.min_thickness * working_scale(bare.shape),
    )
    found = color_pieces(color[::step, ::step], bare, config)
    return replace(found, labels=enlarged(found.labels, segments.bare.shape))


def _status(cloud: RegionCloud, segments: GeometricRegions) -> str:
    """Return the status of a region: measured, flat on the table, or without depth."""
    if len(cloud) < max(MIN_POINTS, MIN_MEASURED * np.count_nonzero(cloud.mask)):
        return REGION_NO_DEPTH
    if segments.plane is None:
        return REGION_MEASURED
    least = segments.least_height(float(cloud.middle[2]))
    stands_out = top_height(cloud.points, segments.plane) > least
    return REGION_MEASURED if stands_out else REGION_FLAT


def why_empty(observation: Observation, *, by_masks: bool = False) -> str:
    """Return the reason why no region of a frame has a grasp.

    `by_masks`: whether the regions are the instances of the user's masks.
    """
    if not by_masks:
        return _why_none_graspable(observation)
    if not observation.regions and not observation.too_small:
        return "the masks contain no instance; number the pixels of each instance, from 1"
    reasons = [_why_none_graspable(observation)] if observation.regions else []
    return "; ".join(filter(None, [*reasons, dropped_instances(observation)]))


def dropped_instances(observation: Observation) -> str:
    """Return a sentence on the instances of the user's masks that are too small, if any are."""
    if not observation.too_small:
        return ""
    all_instances = counted(len(observation.regions) + observation.too_small, "instance")
    return (
        f"dropped {observation.too_small} of {all_instances} of the masks as too small; "
        f"an instance needs {observation.min_region_pixels} pixels"
    )


def _place_of_regions(observation: Observation) -> str:
    """Return a sentence on the place of the regions, as a box in the frame of the workspace."""
    limits, clouds = observation.scene.limits, [cloud for cloud in observation.clouds if len(cloud)]
    if limits is None or not clouds:
        return "they have no depth"
    middles = transform_points(limits.T_box_cam, np.array([cloud.middle for cloud in clouds]))
    low, high = middles.min(axis=0), middles.max(axis=0)
    spans = zip("xyz", low, high, strict=True)
    frame = "camera" if np.array_equal(limits.T_box_cam, np.eye(4)) else "table"
    metres = ", ".join(f"{axis} {a:.2f} to {b:.2f}" for axis, a, b in spans)
    return f"their middles are at {metres} m in the {frame} frame; see `symgrasp workspace`"


def _why_none_graspable(observation: Observation) -> str:
    clouds, limits = observation.clouds, observation.scene.limits
    if clouds and all(len(cloud) < MIN_POINTS for cloud in clouds):
        measured = f"too little depth was measured in {counted(len(clouds), 'region')}"
        return f"{measured}; a region needs {MIN_POINTS} points"
    if not clouds and observation.improbable:
        rated = counted(observation.improbable, "region")
        return f"the detector rates {rated} as no object; see min_rating"
    if not clouds:
        return "nothing stands out from its support; is an object within reach of the camera?"
    inside = len(observation.in_workspace()[0])
    if not inside:
        place = _place_of_regions(observation)
        return f"none of {counted(len(clouds), 'region')} is in the workspace; {place}"
    none = f"none of {counted(inside, 'region')}"
    if limits is not None:
        return f"{none} in the workspace has a grasp within the given limits"
    return f"{none} has a grasp that the gripper reaches without collision"
