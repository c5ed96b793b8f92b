"""True and false candidates: the verdicts that critics of symmetries learn from."""

import numpy as np

from pipelines.geometry.symmetry import Symmetry
from pipelines.geometry.symmetry_error import symmetry_error
from pipelines.metrics.symmetry_matching import TrueRegion, implied_symmetries, scored_symmetries

CENTER_OFFSET = 0.02  # metres between the centres of spheres, at most
HIT_ERROR = 0.25  # dense symmetry error of a hit (Sec. IV-E, D. 11)
# Largest error of a true symmetry, about half of HIT_ERROR: fingers need more precision than a hit.
TRUE_ERROR = 0.134
ALIKE = 0.8  # least cosine of two directions whose error is worth computing

UNKNOWN = np.nan


def symmetry_truth(found: Symmetry, region: TrueRegion) -> float:
    """Return 1 if the plane, axis or sphere `found` is listed for the region, else 0.

    Unknown for symmetries near a listed one, which are hits but too inexact for a finger, and for
    those that follow from other symmetries, such as an axis of a sphere.
    """
    listed = scored_symmetries(region, found.kind)
    if found.kind == "sphere":
        apart = [float(np.linalg.norm(found.point - each.point)) for each in listed]
        return float(min(apart, default=np.inf) < CENTER_OFFSET)
    near = [s for s in listed if abs(float(found.direction @ s.direction)) > ALIKE]
    error = min((symmetry_error(region.points, found, s) for s in near), default=np.inf)
    if error <= TRUE_ERROR:
        return 1.0
    follows = implied_symmetries(found, region.symmetries)
    implied = any(symmetry_error(region.points, found, s) <= HIT_ERROR for s in follows)
    return UNKNOWN if implied or error <= HIT_ERROR else 0.0
