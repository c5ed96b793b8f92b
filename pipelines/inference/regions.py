"""The regions of one frame: from the detector, from the depth alone, both, or the user's masks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask
from pipelines.configs import InferConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.regions_geometric import GeometricRegions

Depth = NDArray[np.float32]


class DetectedRegion(Protocol):
    """A region that a detector found."""

    @property
    def mask(self) -> Mask:
        """(H, W) its pixels."""

    @property
    def confidence(self) -> float:
        """0 to 1."""


class Detector(Protocol):
    """A network that finds regions in a frame."""

    def detect(
        self,
        color: NDArray[np.uint8],
        depth: Depth,
        intrinsics: Intrinsics,
        plane: Plane | None,
    ) -> Sequence[DetectedRegion]:
        """Return the regions of a frame, most confident first.

        Args:
            color: (H, W, 3) RGB.
            depth: (H, W) metres, 0 = missing.
            intrinsics: of both.
            plane: the support plane, where it is known.
        """


@dataclass(frozen=True)
class Region:
    """A region to grasp.

    Attributes:
        mask: (H, W) its pixels.
        confidence: 0 to 1, of the detector.
        source: `detector`, `geometric` or `masks`.
    """

    mask: Mask
    confidence: float
    source: str


def find_regions(
    color: NDArray[np.uint8],
    depth: Depth,
    intrinsics: Intrinsics,
    segments: GeometricRegions,
    config: InferConfig,
    detector: Detector | None = None,
    masks: NDArray[np.int32] | None = None,
) -> tuple[list[Region], int]:
    """Return the regions of a frame, and how many more are below `min_region_pixels`.

    Args:
        color: (H, W, 3) RGB.
        depth: (H, W) metres, 0 = missing.
        intrinsics: of both.
        segments: the pieces that the depth alone shows.
        config: thresholds.
        detector: None for none.
        masks: (H, W) the user's instance ids, 0 = background; with these nothing else is found.
    """
    if masks is not None:
        regions = [Region(masks == i, 1.0, "masks") for i in np.unique(masks[masks > 0])]
    else:
        regions = []
        if detector is not None:
            found = detector.detect(color, depth, intrinsics, segments.plane)
            regions = _standing(found, depth > 0, segments, config)
        if config.regions != "detector":
            regions = _completed(regions, segments, config)
    large = [r for r in regions if np.count_nonzero(r.mask) >= config.min_region_pixels]
    return large, len(regions) - len(large)


def _standing(
    detections: Sequence[DetectedRegion],
    measured: Mask,
    segments: GeometricRegions,
    config: InferConfig,
) -> list[Region]:
    """Return the detections, disjoint, without those of table and background."""
    free = np.ones(measured.shape, bool)
    standing = measured & segments.foreground
    # The network's masks are coarse; what lies on the table is known to the pixel.
    known = segments.foreground | ~measured
    regions = []
    for detection in sorted(detections, key=lambda d: -d.confidence):
        mask = detection.mask & free
        seen = int(np.count_nonzero(mask & measured))
        if np.count_nonzero(mask & standing) < config.min_foreground * max(1, seen):
            continue
        if config.clip_detections:
            mask = mask & known
        free &= ~mask
        regions.append(Region(mask, float(detection.confidence), "detector"))
    return regions


def _completed(
    regions: list[Region], segments: GeometricRegions, config: InferConfig
) -> list[Region]:
    """Return `regions` and those `segments` that they leave mostly uncovered."""
    covered = np.zeros(segments.labels.shape, bool)
    for region in regions:
        covered |= region.mask
    result = list(regions)
    for mask in segments.masks:
        rest = mask & ~covered
        if np.count_nonzero(rest) > config.min_uncovered * np.count_nonzero(mask):
            result.append(Region(rest, config.geometric_confidence, "geometric"))
    return result


def pieces_of(mask: Mask, labels: NDArray[np.int32], config: InferConfig) -> list[Mask]:
    """Return the pieces (H, W) of `mask` (H, W), the largest first; none where it is one (D. 97).

    `labels` (H, W) number the geometric regions, 0 elsewhere. Pieces have at least
    `min_region_pixels`, and a share `min_piece_share` of the mask.
    """
    sizes = np.bincount(labels[mask], minlength=1)
    sizes[0] = 0
    least = max(config.min_region_pixels, config.min_piece_share * np.count_nonzero(mask))
    numbers = np.flatnonzero(sizes >= least)
    if len(numbers) < 2:
        return []
    numbers = numbers[np.argsort(-sizes[numbers], kind="stable")]
    return [mask & (labels == number) for number in numbers]
