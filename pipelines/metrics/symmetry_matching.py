"""Verdicts on the predicted symmetries of a frame, matched one to one by confidence (D. 21).

Reflections and rotations are compared by the dense symmetry error, spheres by the distance of the
centres. A truth lists at most three planes, one axis, one sphere; other symmetries follow from the
listed symmetries (a plane through a continuous axis, any plane or axis through a sphere's centre, a
plane turned with a discrete rotation). A prediction that follows so is neither right nor wrong.
Planes that follow only from an axis that is not listed, as four of a cube's nine, count as wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.geometry.symmetry_error import symmetry_error
from pipelines.geometry.transforms import rotation_about, unit
from pipelines.metrics.average_precision import match_greedy

CORRECT, WRONG, IGNORED = 1, 0, -1
# Planes within these limits are one: a plane that follows from the list may be listed itself.
SAME_PLANE_COSINE = float(np.cos(np.radians(5.0)))
SAME_PLANE_OFFSET = 0.004  # metres, at the axis
IN_PLANE = 0.1  # cosine between axis and normal below which the axis lies in the plane
LEAST_ACROSS = 0.5  # sine between normal and axis from which a plane can pass through the axis


@dataclass(frozen=True)
class PredictedSymmetry:
    """A symmetry with its confidence, in the true region with index `region` (-1: in none)."""

    symmetry: Symmetry
    confidence: float
    region: int


@dataclass(frozen=True)
class TrueRegion:
    """The `points` (n, 3) of a region and its symmetries, metres, in the predictions' frame."""

    points: Array
    symmetries: tuple[Symmetry, ...]


def scored_symmetries(region: TrueRegion, kind: str) -> list[Symmetry]:
    """Return the region's symmetries that a prediction of `kind` has to find."""
    return [
        symmetry
        for symmetry in region.symmetries
        if symmetry.kind == kind and getattr(symmetry, "order", None) is None
    ]


def symmetry_verdicts(
    predictions: Sequence[PredictedSymmetry], regions: Sequence[TrueRegion], threshold: float
) -> NDArray[np.int64]:
    """Return (p,) CORRECT, WRONG or IGNORED for predictions of one kind in one frame.

    `threshold`: largest dense error, or metres for spheres, of a right prediction.
    """
    if not predictions:
        return np.zeros(0, np.int64)
    kind = predictions[0].symmetry.kind
    truths = [(i, s) for i, region in enumerate(regions) for s in scored_symmetries(region, kind)]
    misfit = np.full((len(predictions), len(truths)), np.inf)
    for row, each in zip(misfit, predictions, strict=True):
        for place, (region, truth) in enumerate(truths):
            if region == each.region:
                row[place] = symmetry_error(regions[region].points, each.symmetry, truth)
    matched = match_greedy(
        [p.confidence for p in predictions], np.where(misfit <= threshold, misfit, np.inf)
    )
    verdicts = np.where(matched >= 0, CORRECT, WRONG)
    for i in np.flatnonzero(matched < 0).tolist():
        region = predictions[i].region
        if region >= 0 and _follows(predictions[i].symmetry, regions[region], threshold):
            verdicts[i] = IGNORED
    return verdicts


def _follows(predicted: Symmetry, region: TrueRegion, threshold: float) -> bool:
    """Return whether `predicted` is close to a symmetry that follows from the listed symmetries."""
    implied = implied_symmetries(predicted, region.symmetries)
    return any(symmetry_error(region.points, predicted, s) <= threshold for s in implied)


def implied_symmetries(predicted: Symmetry, listed: Sequence[Symmetry]) -> list[Symmetry]:
    """Return the symmetries nearest to `predicted` that follow from `listed` but are unlisted."""
    implied: list[Symmetry] = []
    for truth in listed:
        match predicted, truth:
            case ReflectionSymmetry() | RotationSymmetry(), SphereSymmetry():
                implied.append(replace(predicted, point=truth.point))
            case ReflectionSymmetry(), RotationSymmetry(order=None):
                across = predicted.normal - (predicted.normal @ truth.axis) * truth.axis
                if np.linalg.norm(across) > LEAST_ACROSS:
                    implied.append(ReflectionSymmetry(unit(across), truth.point))
            case ReflectionSymmetry(), RotationSymmetry():
                implied += _turned_planes(listed, truth)
            case _:
                pass
    return implied


def _turned_planes(
    listed: Sequence[Symmetry], rotation: RotationSymmetry
) -> list[ReflectionSymmetry]:
    """Return the planes through a discrete `rotation`'s axis that follow from a listed one.

    An n-fold axis in a mirror plane lies in n mirror planes, half the rotation's step apart. Planes
    that are listed themselves are left out: each of them is to be found once.
    """
    order = rotation.order or 1
    through = [
        plane
        for plane in listed
        if isinstance(plane, ReflectionSymmetry) and abs(plane.normal @ rotation.axis) < IN_PLANE
    ]
    turned = [
        _turned(plane, rotation, np.pi * k / order) for plane in through for k in range(1, order)
    ]
    known = [p for p in through if abs((rotation.point - p.point) @ p.normal) <= SAME_PLANE_OFFSET]
    return [t for t in turned if all(abs(t.normal @ p.normal) < SAME_PLANE_COSINE for p in known)]


def _turned(
    plane: ReflectionSymmetry, rotation: RotationSymmetry, angle: float
) -> ReflectionSymmetry:
    """Return `plane` turned by `angle` radians about the axis of `rotation`."""
    normal = rotation_about(rotation.axis, angle) @ plane.normal
    return replace(plane, normal=normal, point=rotation.turn(plane.point[None], angle)[0])
