"""Counts of true, false and missed symmetries of annotated objects."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from tests.mesh_symmetry.varied import defects
from tests.mesh_symmetry.varied.shapes import Plane, Varied

MAX_DEG, MAX_OFFSET = 5.0, 0.02  # of the diagonal
SLOTS = 3  # the largest number of requested planes


def judged(truth: Varied, found: Sequence[Symmetry]) -> Counter[str]:
    """Return the numbers of true and false symmetries in `found` and of missed ones, by kind."""
    size = defects.size_of(truth.mesh.vertices)
    tally = Counter[str]()
    hits = set[int]()
    for symmetry in found:
        match symmetry:
            case ReflectionSymmetry():
                plane = (symmetry.normal, symmetry.point)
                index = _index(plane, truth.planes, size)
                is_unclear = _index(plane, truth.unclear, 2.0 * size) is not None
                if index is not None:
                    hits.add(index)
                elif not is_unclear and not _contains(plane, truth):
                    tally["false plane"] += 1
            case RotationSymmetry(order=None):
                tally["axis" if _is_axis(symmetry, truth, size) else "false axis"] += 1
            case SphereSymmetry():
                tally["false sphere"] += 1
    tally["plane"] = len(hits)
    tally["missed plane"] = min(len(truth.planes), SLOTS) - min(len(hits), SLOTS)
    tally["missed axis"] = int(truth.axis is not None and not tally["axis"])
    return tally


def _index(plane: Plane, planes: Sequence[Plane], size: float) -> int | None:
    for index, (normal, point) in enumerate(planes):
        offset = abs(normal @ (plane[1] - point)) / size
        if _degrees(plane[0], normal) < MAX_DEG and offset < MAX_OFFSET:
            return index
    return None


def _contains(plane: Plane, truth: Varied) -> bool:
    if truth.axis is None:
        return False
    direction, point = truth.axis
    offset = abs(plane[0] @ (plane[1] - point)) / defects.size_of(truth.mesh.vertices)
    return 90.0 - _degrees(plane[0], direction) < MAX_DEG and offset < MAX_OFFSET


def _is_axis(symmetry: RotationSymmetry, truth: Varied, size: float) -> bool:
    if truth.axis is None:
        return False
    direction, point = truth.axis
    arm = symmetry.point - point
    offset = float(np.linalg.norm(arm - direction * (arm @ direction))) / size
    return _degrees(symmetry.axis, direction) < MAX_DEG and offset < MAX_OFFSET


def _degrees(a: Array, b: Array) -> float:
    return float(np.degrees(np.arccos(min(1.0, abs(float(a @ b))))))
