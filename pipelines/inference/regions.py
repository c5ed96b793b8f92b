"""The regions of one frame: from the detector, from the depth alone, both, or the user's masks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import InferConfig
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.regions_geometric import GeometricRegions, geometric_regions

Mask = NDArray[np.bool_]

SOURCES = ("auto", "detector", "geometric")


class Detection(Protocol):
    """One region that a detector found."""

    @property
    def mask(self) -> Mask:
        """(H, W) its pixels."""

    @property
    def confidence(self) -> float:
        """0 to 1."""


class Detector(Protocol):
    """What finds regions in a frame, most confident first."""

    def detect(
        self,
        color: NDArray[np.uint8],
        depth: NDArray[np.float32],
        intrinsics: Intrinsics,
        plane: Plane | None,
    ) -> Sequence[Detection]:
        """Return the regions of a frame; `depth` (H, W) in metres, 0 = missing.

        `plane`: that things stand on, where it is known.
        """


@dataclass(frozen=True)
class Region:
    """A region to grasp: pixels (H, W), confidence 0 to 1, `detector`, `geometric` or `masks`."""

    mask: Mask
    confidence: float
    source: str


@dataclass(frozen=True)
class FrameRegions:
    """The regions of a frame, and what the depth alone says of the table.

    `too_small`: how many more there would be with fewer than `min_region_pixels`.
    """

    regions: list[Region]
    geometric: GeometricRegions
    too_small: int = 0


def find_regions(
    frame: Frame,
    config: InferConfig,
    rng: np.random.Generator,
    detector: Detector | None = None,
    masks: NDArray[np.int32] | None = None,
) -> FrameRegions:
    """Return the regions of `frame`; `masks` (H, W) are the user's instance ids, 0 = background.

    What the masks show is no support: without depth beside it no plane is known.
    """
    ground = None if masks is None else masks == 0
    geometric = geometric_regions(frame.depth, frame.intrinsics, config.region, rng, ground)
    if masks is not None:
        regions = [Region(masks == i, 1.0, "masks") for i in np.unique(masks[masks > 0])]
    else:
        regions = _detected(frame, geometric, config, detector)
        if config.regions != "detector":
            regions = _completed(regions, geometric, config)
    large = [r for r in regions if np.count_nonzero(r.mask) >= config.min_region_pixels]
    return FrameRegions(large, geometric, len(regions) - len(large))


def _detected(
    frame: Frame, geometric: GeometricRegions, config: InferConfig, detector: Detector | None
) -> list[Region]:
    """Return the detector's regions, disjoint, without those of table and background."""
    if detector is None:
        return []
    free = np.ones(frame.depth.shape, bool)
    measured = frame.depth > 0
    standing = measured & geometric.foreground
    # The network's masks are coarse; what lies on the table is known to the pixel.
    known = geometric.foreground | (frame.depth <= 0)
    regions = []
    found = detector.detect(frame.color, frame.depth, frame.intrinsics, geometric.plane)
    for detection in sorted(found, key=lambda d: -d.confidence):
        mask = detection.mask & free
        seen = int(np.count_nonzero(mask & measured))
        if np.count_nonzero(mask & standing) < config.min_foreground * max(1, seen):
            continue
        mask = mask & known
        free &= ~mask
        regions.append(Region(mask, float(detection.confidence), "detector"))
    return regions


def _completed(
    regions: list[Region], geometric: GeometricRegions, config: InferConfig
) -> list[Region]:
    """Add the geometric regions that the others leave mostly uncovered."""
    covered = np.zeros(geometric.labels.shape, bool)
    for region in regions:
        covered |= region.mask
    result = list(regions)
    for mask in geometric.masks:
        rest = mask & ~covered
        if np.count_nonzero(rest) > config.min_uncovered * np.count_nonzero(mask):
            result.append(Region(rest, config.geometric_confidence, "geometric"))
    return result
