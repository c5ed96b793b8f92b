"""The regions of one frame: from the detector, from the depth alone, both, or the user's masks.

Colour completes them (D. 131): a piece of colour around a single region is the rest of it, and a
piece that no region explains is a region of its own: too thin for the depth's noise, or without
depth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask
from pipelines.configs import ColorConfig, InferConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.quantiles import median, quantiles
from pipelines.geometry.pointcloud import Plane
from pipelines.grasp_files.grasps_tables import REGION_MEASURED
from pipelines.tabletop.regions.color import ColorPieces
from pipelines.tabletop.regions_geometric import GeometricRegions, without_holes

Depth = NDArray[np.float32]

REST = "rest"  # source of the region of grasps that lie on no other
LEAST_ADDED = 0.03  # share of a region's pixels below which nothing is added to it
SAMPLE = 500  # pixels of a region, about, whose heights are measured
CABLE = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))  # no part of a thing is narrower


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
        source: `detector`, `geometric`, `color` or `masks`; `rest` for what lies beside them all.
        status: `measured`; `flat` where its depth is that of the table, as far as noise allows to
            tell; `no_depth` where hardly any depth was measured.
    """

    mask: Mask
    confidence: float
    source: str
    status: str = REGION_MEASURED

    @property
    def is_graspable(self) -> bool:
        """Whether grasps are looked for: not where colour alone shows that there is a thing."""
        return self.source != "color" or self.status == REGION_MEASURED


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
        if not segments.may_be_thing(mask):
            continue
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


def with_color(
    regions: list[Region],
    pieces: ColorPieces,
    segments: GeometricRegions,
    depth: Depth,
    intrinsics: Intrinsics,
    config: InferConfig,
) -> list[Region]:
    """Return `regions` (n) as the `pieces` of colour complete and join them, and new ones.

    Args:
        regions: disjoint.
        pieces: of the same image.
        segments: the support plane, and the pixels measured on it.
        depth: (H, W) metres, 0 = missing.
        intrinsics: of the image.
        config: thresholds.
    """
    work = _Completion(pieces, segments, depth, intrinsics, config.region.color)
    count = len(pieces.whole)
    inside = np.array([np.bincount(pieces.labels[r.mask], minlength=count) for r in regions])
    inside = inside.reshape(len(regions), count)
    sizes = np.array([np.count_nonzero(region.mask) for region in regions])
    covered = np.zeros(depth.shape, np.bool_)
    for region in regions:
        covered |= region.mask
    result, gone, new = list(regions), set[int](), list[Region]()
    for number in range(1, count):
        piece = pieces.labels == number
        members = np.flatnonzero(inside[:, number] > config.region.color.min_confined * sizes)
        rest = piece & ~covered
        if not len(members):
            large = np.count_nonzero(rest) >= config.min_region_pixels
            mostly = np.count_nonzero(rest) > config.min_uncovered * np.count_nonzero(piece)
            # What clearly stands out is found by depth, or is a wall or an arm.
            if pieces.whole[number] and large and mostly and work.is_low(rest):
                new.append(Region(rest, config.geometric_confidence, "color"))
            continue
        own = [result[member] for member in members]
        if len(members) > 1 and not work.are_one(own, piece):
            continue
        result[members[0]] = work.completed(own, rest)
        gone.update(members[1:].tolist())
    return [region for place, region in enumerate(result) if place not in gone] + new


@dataclass(frozen=True)
class _Completion:
    pieces: ColorPieces
    segments: GeometricRegions
    depth: Depth
    intrinsics: Intrinsics
    config: ColorConfig

    def are_one(self, regions: list[Region], piece: Mask) -> bool:
        """Return whether `regions` within one `piece` are parts of a thing hardly above noise."""
        outline = np.ascontiguousarray(np.argwhere(piece)[:, ::-1].astype(np.int32))
        convex = cv2.contourArea(cv2.convexHull(outline))
        solid = np.count_nonzero(piece) >= self.config.min_convexity * convex
        return bool(solid) and all(self.is_low(region.mask) for region in regions)

    def completed(self, regions: list[Region], rest: Mask) -> Region:
        """Return the union of `regions` with what they leave of a piece, `rest`."""
        mask = regions[0].mask.copy()
        for region in regions[1:]:
            mask |= region.mask
        if np.count_nonzero(rest) < LEAST_ADDED * np.count_nonzero(mask):
            return replace(regions[0], mask=mask)
        x, y, width, height = cv2.boundingRect((mask | rest).view(np.uint8))
        window = slice(y, y + height), slice(x, x + width)
        own, free = mask[window], rest[window]
        more = free if self.is_low(mask) else free & ~self.segments.bare[window]
        thick = cv2.morphologyEx((own | more).astype(np.uint8), cv2.MORPH_OPEN, CABLE) > 0
        count, labels = cv2.connectedComponents((thick | own).view(np.uint8), connectivity=8)
        touched = np.bincount(labels[own], minlength=count) > 0
        grown = own | (more & thick & touched[labels])
        mask[window] = grown | (without_holes(grown) & free)
        return replace(regions[0], mask=mask)

    def is_low(self, mask: Mask) -> bool:
        """Return whether most of `mask` (H, W) is not far above the noise over the plane."""
        plane = self.segments.plane
        at = np.flatnonzero(mask & (self.depth > 0))
        if plane is None or not len(at):
            return plane is not None
        at = at[:: max(1, len(at) // SAMPLE)]
        rows, columns = np.divmod(at, mask.shape[1])
        z, lens = self.depth.ravel()[at].astype(np.float64), self.intrinsics
        x, y = (columns - lens.cx) * z / lens.fx, (rows - lens.cy) * z / lens.fy
        height = quantiles(plane.height(np.stack([x, y, z], axis=1)), 0.9)
        return bool(height < self.config.max_low * self.segments.least_height(float(median(z))))
