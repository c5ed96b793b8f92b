"""Regions completed, joined and added by colour (D. 131).

A piece of colour around a single region completes this region. A piece that no region covers is a
new region: too thin for the depth's noise, or without depth.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipelines.array_types import Mask
from pipelines.configs import ColorConfig, InferConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.quantiles import median
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.inference.regions.regions import Depth, Region
from pipelines.tabletop.regions.color import ColorPieces
from pipelines.tabletop.regions.object_criteria import top_height
from pipelines.tabletop.regions.pieces import box_of
from pipelines.tabletop.regions_geometric import GeometricRegions, without_holes

LEAST_ADDED = 0.03  # share of a region's pixels below which nothing is added to it
SAMPLE = 500  # approximate number of pixels of a region for its heights
NARROWEST = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))  # no part of an object is narrower


def with_color(
    regions: list[Region],
    pieces: ColorPieces,
    segments: GeometricRegions,
    depth: Depth,
    intrinsics: Intrinsics,
    config: InferConfig,
) -> list[Region]:
    """Return disjoint `regions`, completed and joined by the `pieces` of colour, and new regions.

    `depth`: (H, W) metres, 0 = missing.
    """
    completion = _ColorCompletion(segments, depth, intrinsics, config.region.color)
    count = len(pieces.may_be_object)
    inside = np.array([np.bincount(pieces.labels[r.mask], minlength=count) for r in regions])
    inside = inside.reshape(len(regions), count)
    sizes = np.array([np.count_nonzero(region.mask) for region in regions])
    covered = segments.hanging  # colour may join an object to an arm behind it
    for region in regions:
        covered |= region.mask
    result, gone, new = list(regions), set[int](), list[Region]()
    for number in range(1, count):
        piece = pieces.labels == number
        members = np.flatnonzero(inside[:, number] > config.region.color.min_confined * sizes)
        rest = piece & ~covered
        own = [result[member] for member in members]
        if not own:
            is_new = pieces.may_be_object[number] and _is_mostly_new(piece, rest, config)
            # A piece that clearly stands out is found by depth, or is a wall or an arm.
            if is_new and completion.is_low(rest):
                new.append(Region(rest, config.geometric_confidence, "color"))
        elif len(own) == 1 or completion.are_one_object(own, piece):
            result[members[0]] = completion.completed(own, rest)
            gone.update(members[1:].tolist())
    return [region for place, region in enumerate(result) if place not in gone] + new


def _is_mostly_new(piece: Mask, rest: Mask, config: InferConfig) -> bool:
    """Return whether `rest`, the uncovered part of `piece`, is large by itself and as a share."""
    size = np.count_nonzero(rest)
    is_most = size > config.min_uncovered * np.count_nonzero(piece)
    return bool(is_most and size >= config.min_region_pixels)


@dataclass(frozen=True)
class _ColorCompletion:
    segments: GeometricRegions
    depth: Depth
    intrinsics: Intrinsics
    config: ColorConfig

    def are_one_object(self, regions: list[Region], piece: Mask) -> bool:
        """Return whether `regions` in one `piece` are parts of an object hardly above the noise."""
        outline = np.ascontiguousarray(np.argwhere(piece)[:, ::-1].astype(np.int32))
        convex = cv2.contourArea(cv2.convexHull(outline))
        solid = np.count_nonzero(piece) >= self.config.min_convexity * convex
        return bool(solid) and all(self.is_low(region.mask) for region in regions)

    def completed(self, regions: list[Region], rest: Mask) -> Region:
        """Return the union of `regions` with `rest`, the uncovered part of their piece."""
        mask = regions[0].mask.copy()
        for region in regions[1:]:
            mask |= region.mask
        if np.count_nonzero(rest) < LEAST_ADDED * np.count_nonzero(mask):
            return replace(regions[0], mask=mask)
        window = box_of(mask | rest)
        own, free = mask[window], rest[window]
        more = free if self.is_low(mask) else free & ~self.segments.bare[window]
        thick = cv2.morphologyEx((own | more).astype(np.uint8), cv2.MORPH_OPEN, NARROWEST) > 0
        count, labels = cv2.connectedComponents((thick | own).view(np.uint8), connectivity=8)
        touched = np.bincount(labels[own], minlength=count) > 0
        grown = own | (more & thick & touched[labels])
        mask[window] = grown | (without_holes(grown) & free)
        return replace(regions[0], mask=mask)

    def is_low(self, mask: Mask) -> bool:
        """Return whether most of `mask` (H, W) is hardly higher over the plane than the noise.

        True for a mask without depth; False without a plane.
        """
        plane = self.segments.plane
        at = np.flatnonzero(mask & (self.depth > 0))
        if plane is None or not len(at):
            return plane is not None
        at = strided_at_least(at, SAMPLE)
        rows, columns = np.divmod(at, mask.shape[1])
        z, camera = self.depth.ravel()[at].astype(np.float64), self.intrinsics
        x, y = (columns - camera.cx) * z / camera.fx, (rows - camera.cy) * z / camera.fy
        height = top_height(np.stack([x, y, z], axis=1), plane)
        return bool(height < self.config.max_low * self.segments.least_height(float(median(z))))
