"""Regions without a network: pieces of the foreground that may be objects on the table."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Floats, Mask
from pipelines.configs import RegionConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.quantiles import median
from pipelines.geometry.pointcloud import Plane
from pipelines.tabletop.depth_segments import Labels, segment
from pipelines.tabletop.regions.object_criteria import ObjectCriteria
from pipelines.tabletop.regions.pieces import Box, pieces_of_labels
from pipelines.tabletop.regions.standing import standing
from pipelines.tabletop.tabletop import find_tabletop

WORKING_WIDTH = 640  # pixels; larger images are thinned to about this width
FEWEST_PIXELS = 20  # of a region, however small the image


@dataclass(frozen=True)
class GeometricRegions:
    """Regions of one frame.

    Attributes:
        labels: (H, W) 1, 2, ... for regions, 0 elsewhere.
        plane: support plane, camera frame, normal to the camera's side; None without one.
        foreground: (H, W) pixels above the plane, in a region or not.
        bare: (H, W) pixels measured on the plane.
        criteria: for further regions, at the working size.
    """

    labels: Labels
    plane: Plane | None
    foreground: Mask
    bare: Mask
    criteria: ObjectCriteria

    def least_height(self, z: float) -> float:
        """Return the height over the plane that stands out from noise at depth `z`, metres."""
        return float(self.criteria.tabletop.threshold(z, self.criteria.config))

    def may_be_object(self, mask: Mask) -> bool:
        """Return whether `mask` (H, W) is no wall, no arm and not too large; True without depth."""
        step = working_step(mask.shape)
        return self.criteria.may_be_object(mask[::step, ::step])

    @property
    def hanging(self) -> Mask:
        """The pixels (H, W) of pieces that do not reach down to the support; a copy."""
        return enlarged(self.criteria.hanging, self.labels.shape) > 0

    @property
    def masks(self) -> list[Mask]:
        """The regions one by one, (H, W) each."""
        return [self.labels == index for index in range(1, int(self.labels.max(initial=0)) + 1)]


def geometric_regions(
    depth: Floats,
    intrinsics: Intrinsics,
    config: RegionConfig,
    rng: np.random.Generator,
    ground: Mask | None = None,
) -> GeometricRegions:
    """Find the regions of `depth` (H, W) metres, 0 where missing.

    `ground`: (H, W) pixels that may show the support, if known.
    """
    step = working_step(depth.shape)
    small = depth[::step, ::step]
    config = replace(config, min_pixels=least_pixels(config.min_pixels, small.shape))
    # Thinned, not resampled: pixel n is pixel n * step, without the half pixel of `resized`.
    fx, fy, cx, cy = (each / step for each in intrinsics.lens)
    camera = Intrinsics(fx, fy, cx, cy, small.shape[1], small.shape[0])
    xyz = camera.backproject(small)
    ground_seen = None if ground is None else ground[::step, ::step]
    tabletop = find_tabletop(xyz, camera, config, rng, ground_seen)
    pieces, surfaces = segment(xyz, tabletop.foreground, tabletop.clear, camera.fx, config)
    stands = standing(xyz, surfaces, tabletop, camera, config)
    criteria = ObjectCriteria(xyz, tabletop, ~stands[surfaces], config)
    labels = _sound_regions(pieces, criteria)
    above, bare = (
        enlarged(image, depth.shape) > 0 for image in (tabletop.foreground, tabletop.bare)
    )
    return GeometricRegions(enlarged(labels, depth.shape), tabletop.plane, above, bare, criteria)


def working_step(shape: tuple[int, ...]) -> int:
    """Return the stride of rows and columns that thins an image of `shape` to a working size."""
    return max(1, round(max(shape) / WORKING_WIDTH))


def working_scale(shape: tuple[int, ...]) -> float:
    """Return the longer side of an image of `shape` by `WORKING_WIDTH`, at most 1."""
    return min(1.0, max(shape) / WORKING_WIDTH)


def least_pixels(usual: int, shape: tuple[int, ...]) -> int:
    """Return the least number of pixels of a piece in an image of `shape`, thinned or not.

    `usual`: of an image of `WORKING_WIDTH` or more; the same piece has fewer in a smaller image.
    """
    return min(usual, max(FEWEST_PIXELS, round(usual * working_scale(shape) ** 2)))


def enlarged(image: NDArray[np.generic], shape: tuple[int, ...]) -> Labels:
    """Return a thinned `image` (h, w) of labels at the size `shape`, (H, W), by the nearest label.

    With an even stride two labels are equally near in the middle; the upper left one is taken.
    """
    if image.shape == shape:
        return image.astype(np.int32)
    step = working_step(shape)
    rows, columns = (
        np.minimum((np.arange(size) + (step - 1) // 2) // step, thinned - 1)
        for size, thinned in zip(shape, image.shape, strict=True)
    )
    labels: Labels = image.astype(np.int32)[rows][:, columns]
    return labels


def _sound_regions(labels: Labels, criteria: ObjectCriteria) -> Labels:
    """Renumber the regions that may be objects, holes filled, nearest first; drop the others."""
    kept: list[tuple[float, Mask, Box]] = []
    for piece in pieces_of_labels(labels, criteria.xyz, criteria.config.min_pixels):
        if criteria.hanging.ravel()[piece.pixels[0]]:
            continue
        mask = labels[piece.box] == piece.label
        if (
            criteria.has_size_and_place(piece.points, piece.pixels)
            and criteria.stands_out(piece.points)
            and not criteria.is_smear(piece.points)
        ):
            filled = without_holes(mask) & ((labels[piece.box] == 0) | mask)
            kept.append((float(median(piece.points[:, 2])), filled, piece.box))
    result = np.zeros(labels.shape, np.int32)
    for number, (_, mask, box) in enumerate(sorted(kept, key=lambda entry: entry[0]), 1):
        result[box][mask] = number
    return result


def without_holes(mask: Mask) -> Mask:
    """Return `mask` (h, w) with its holes filled (4-connected)."""
    outside = np.pad(mask.astype(np.uint8), 1)
    cv2.floodFill(outside, None, (0, 0), 1)
    return np.asarray((outside[1:-1, 1:-1] == 0) | mask)
