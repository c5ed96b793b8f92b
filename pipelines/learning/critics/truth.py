"""True and false candidates: the verdicts that critics of symmetries learn from."""

from collections.abc import Sequence

import numpy as np

from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, Symmetry
from pipelines.geometry.symmetry_error import symmetry_error
from pipelines.metrics.symmetry_matching import TrueRegion, implied_symmetries, scored_symmetries

AXIS_ANGLE = np.radians(12.0)  # largest angle of a true axis to the listed axis; chosen by eye
AXIS_OFFSET = 0.008  # metres, largest distance of a true axis from the listed axis
CENTRE_OFFSET = 0.02  # metres between the centres of spheres, at most
HIT_ERROR = 0.25  # dense symmetry error of a hit (Sec. IV-E, D. 11)
# Largest error of a true plane, about half of HIT_ERROR: fingers need more precision than a hit.
PLANE_ERROR = 0.134
ALIKE = 0.8  # least cosine of normals of two planes whose error is worth computing

UNKNOWN = np.nan


def axis_truth(found: Symmetry, listed: Sequence[Symmetry]) -> float:
    """Return 1 if the axis or sphere `found` is one of `listed`, else 0.

    Unknown for an axis of a sphere, for which every axis is true.
    """
    if found.kind == "rotation" and any(each.kind == "sphere" for each in listed):
        return UNKNOWN
    return float(any(_matches(found, each) for each in listed))


def _matches(found: Symmetry, listed: Symmetry) -> bool:
    if listed.kind != found.kind:
        return False
    apart = found.point - listed.point
    if not isinstance(listed, RotationSymmetry):
        return float(np.linalg.norm(apart)) < CENTRE_OFFSET
    if listed.order is not None:
        return False
    cosine = abs(float(found.direction @ listed.direction))
    off = float(np.linalg.norm(np.cross(apart, listed.direction)))
    return cosine > np.cos(AXIS_ANGLE) and off < AXIS_OFFSET


def plane_truth(plane: ReflectionSymmetry, region: TrueRegion) -> float:
    """Return 1 if `plane` is listed for the region, else 0.

    Unknown for planes near a listed plane, which are hits but too inexact for a finger, and for
    planes that follow from other symmetries.
    """
    listed = scored_symmetries(region, "reflection")
    near = [s for s in listed if abs(float(plane.normal @ s.direction)) > ALIKE]
    error = min((symmetry_error(region.points, plane, s) for s in near), default=np.inf)
    if error <= PLANE_ERROR:
        return 1.0
    follows = implied_symmetries(plane, region.symmetries)
    implied = any(symmetry_error(region.points, plane, s) <= HIT_ERROR for s in follows)
    return UNKNOWN if implied or error <= HIT_ERROR else 0.0
