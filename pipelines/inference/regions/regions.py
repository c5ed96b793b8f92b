"""The regions of one frame: from the detector, the depth alone, both, or the user's masks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask
from pipelines.configs import InferConfig
from pipelines.grasp_files.grasps_tables import REGION_MEASURED
from pipelines.tabletop.regions.containers import insides
from pipelines.tabletop.regions.pieces import box_of
from pipelines.tabletop.regions_geometric import GeometricRegions, working_step

if TYPE_CHECKING:
    from pipelines.network.detection.detector import Detection

Depth = NDArray[np.float32]

REST = "rest"  # source of the region of grasps on no other region
SOURCES = "masks", "detector", "geometric", "color"  # the most certain first
CONFINED = 0.6  # share of a region within a segment from which the segment may complete it
MIN_STRIPS = 0.02  # smallest share of a detection in other segments that is cut off (D. 145)
MIN_WIDTH = 21  # pixels, of the working size; a narrower rest is an error of detections


@dataclass(frozen=True)
class Region:
    """A region to grasp.

    Attributes:
        mask: (H, W) pixels of the region.
        confidence: 0 to 1, of the detector; for a rated region the estimated probability that it
            is an object.
        source: `detector`, `geometric`, `color` or `masks`; `rest` for pixels of no other region.
        status: `measured`; `flat` if its depth cannot be distinguished from the table's;
            `no_depth` if hardly any depth was measured.
        is_rated: whether the detector did not find the region, but has rated it (D. 147).
        instance: id in the user's masks; -1 without.
    """

    mask: Mask
    confidence: float
    source: str
    status: str = REGION_MEASURED
    is_rated: bool = False
    instance: int = -1

    @property
    def is_graspable(self) -> bool:
        """Whether grasps are sought: not where colour alone shows the region."""
        return self.source != "color" or self.status == REGION_MEASURED


def find_regions(
    depth: Depth,
    segments: GeometricRegions,
    config: InferConfig,
    detections: Sequence["Detection"],
    masks: NDArray[np.int32] | None,
) -> tuple[list[Region], int]:
    """Return the regions of a frame, and the number of regions below `min_region_pixels`.

    `depth`: (H, W) metres, 0 = missing. `segments`: the parts of the foreground that the depth
    alone separates. `masks`: (H, W) the user's instance ids, 0 = background; these replace found
    regions.
    """
    if masks is not None:
        ids, sizes = np.unique(masks[masks > 0], return_counts=True)
        enough = sizes >= config.min_region_pixels
        regions = [Region(masks == i, 1.0, "masks", instance=i) for i in ids[enough].tolist()]
        return regions, int(np.count_nonzero(~enough))
    regions = _from_detections(detections, depth > 0, segments, config)
    if config.regions != "detector":
        regions = _completed_by_depth(regions, segments, config)
    large = [r for r in regions if np.count_nonzero(r.mask) >= config.min_region_pixels]
    return large, len(regions) - len(large)


def _from_detections(
    detections: Sequence["Detection"],
    measured: Mask,
    segments: GeometricRegions,
    config: InferConfig,
) -> list[Region]:
    """Return the detections as disjoint regions, without detections of table and background."""
    free = np.ones(measured.shape, bool)
    standing = measured & segments.foreground
    # The network's masks are coarse; the foreground is known to the pixel.
    known = segments.foreground | ~measured
    regions = []
    for detection in sorted(detections, key=lambda d: -d.confidence):
        mask = detection.mask & free
        seen = int(np.count_nonzero(mask & measured))
        if np.count_nonzero(mask & standing) < config.min_foreground * max(1, seen):
            continue
        if config.clip_detections:
            mask = mask & known
        if not segments.may_be_object(mask):
            continue
        free &= ~mask
        regions.append(Region(mask, float(detection.confidence), "detector"))
    return regions


def _completed_by_depth(
    regions: list[Region], segments: GeometricRegions, config: InferConfig
) -> list[Region]:
    """Return `regions`, completed by `segments`, and further regions of `segments` (D. 135).

    A segment that is mostly uncovered is a region. In any other segment, a single region takes the
    uncovered rest; with several regions, thick parts of the rest are regions.
    """
    labels = segments.labels
    sizes = np.bincount(labels.ravel())
    inside = np.array([np.bincount(labels[r.mask], minlength=len(sizes)) for r in regions])
    inside = inside.reshape(len(regions), len(sizes))
    confined = inside > CONFINED * np.array([np.count_nonzero(r.mask) for r in regions])[:, None]
    covered = np.zeros(labels.shape, np.bool_)
    for region in regions:
        covered |= region.mask
    result, new = list(regions), []
    for number in range(1, len(sizes)):
        rest = (labels == number) & ~covered
        uncovered, own = np.count_nonzero(rest), np.flatnonzero(confined[:, number])
        if uncovered > config.min_uncovered * sizes[number]:
            new.append(rest)
        elif uncovered and len(own) == 1:
            result[own[0]] = replace(result[own[0]], mask=result[own[0]].mask | rest)
        elif uncovered:
            new += _thick_parts(rest)
    return result + [Region(mask, config.geometric_confidence, "geometric") for mask in new]


def _thick_parts(mask: Mask) -> list[Mask]:
    """Return the parts (H, W) of `mask` (H, W) that are as wide as `MIN_WIDTH`."""
    box = box_of(mask)
    size = MIN_WIDTH * working_step(mask.shape)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    cut = np.pad(mask[box].astype(np.uint8), size)
    thick = cv2.morphologyEx(cut, cv2.MORPH_OPEN, disc)[size:-size, size:-size]
    count, labels = cv2.connectedComponents(thick, connectivity=4)
    parts = []
    for number in range(1, count):
        part = np.zeros_like(mask)
        part[box] = labels == number
        parts.append(part)
    return parts


def pieces_of(mask: Mask, labels: NDArray[np.int32], config: InferConfig) -> list[Mask]:
    """Return the pieces (H, W) of `mask` (H, W), the largest first; none if it is whole (D. 97).

    `labels` (H, W) number the geometric regions, 0 elsewhere. Pieces have at least
    `min_region_pixels`, and a share `min_piece_share` of the mask. A single piece is the mask
    without strips of other geometric regions (D. 145).
    """
    sizes = np.bincount(labels[mask], minlength=1)
    sizes[0] = 0
    whole = np.count_nonzero(mask)
    numbers = np.flatnonzero(sizes >= max(config.min_region_pixels, config.min_piece_share * whole))
    if len(numbers) == 1:
        strips = (sizes.sum() - sizes.max()) / whole
        own = mask & np.isin(labels, (0, numbers[0]))
        return [own] if MIN_STRIPS < strips < config.min_piece_share else []
    numbers = numbers[np.argsort(-sizes[numbers], kind="stable")]
    return [mask & (labels == number) for number in numbers]


def with_containers_joined(regions: list[Region], segments: GeometricRegions) -> list[Region]:
    """Return disjoint `regions`, with outside and inside of a container as one region (D. 134)."""
    if not regions:
        return regions
    step = working_step(segments.bare.shape)
    labels = np.zeros(segments.criteria.xyz.shape[:2], np.int32)
    for number, region in enumerate(regions, 1):
        labels[region.mask[::step, ::step]] = number
    result, found = list(regions), insides(labels, segments.criteria)
    for inside, outside in found.items():
        one, other = result[inside - 1], result[outside - 1]
        best = min(one, other, key=lambda region: SOURCES.index(region.source))
        result[outside - 1] = replace(best, mask=one.mask | other.mask)
    return [region for number, region in enumerate(result, 1) if number not in found]
