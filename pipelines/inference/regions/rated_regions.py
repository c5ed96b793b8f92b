"""Regions that the detector did not find, rated by its confidence in their boxes (D. 147).

Depth and colour also separate parts of the rims and walls of bins and trays. For these parts the
detector's confidence is far lower than for objects that it missed.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import InferConfig
from pipelines.inference.regions.regions import Region
from pipelines.tabletop.regions.pieces import box_of

if TYPE_CHECKING:
    from pipelines.network.detection.detector import ExaminedFrame

# Log odds that a region is an object, by the log odds of its box, on the regions of dev.
OFFSET, SLOPE = 2.65, 0.58


def rated_by_detector(
    regions: list[Region], examined: "ExaminedFrame", config: InferConfig
) -> list[Region]:
    """Return `regions`, those that only depth or colour shows rated, without the improbable ones.

    Regions rated below `min_rating` are left out. The confidence of the others is the estimated
    probability that the region is an object.
    """
    places = [i for i, region in enumerate(regions) if region.source in ("geometric", "color")]
    if not places:
        return regions
    boxes = np.array([_box(regions[place]) for place in places], np.float64)
    ratings = examined.confidences(boxes)
    result: list[Region | None] = list(regions)
    for place, rating, probability in zip(places, ratings, _probability(ratings), strict=True):
        kept = rating >= config.min_rating
        rated = replace(regions[place], confidence=float(probability), is_rated=True)
        result[place] = rated if kept else None
    return [region for region in result if region is not None]


def _box(region: Region) -> tuple[int, int, int, int]:
    rows, columns = box_of(region.mask)
    return columns.start, rows.start, columns.stop, rows.stop


def _probability(rating: Array) -> Array:
    """Return the probability (n,) of an object, given the `rating` (n,) of its box."""
    tiny = np.finfo(np.float64).tiny
    odds = np.maximum(rating, tiny) / np.maximum(1.0 - rating, 1e-12)
    return np.asarray(1.0 / (1.0 + np.exp(-OFFSET) * odds**-SLOPE))
