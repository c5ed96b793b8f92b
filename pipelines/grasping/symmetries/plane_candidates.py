"""Candidate mirror planes of a region, from its shape and from the network, not yet scored.

The planes of a box follow from its faces and its outline, the planes of a can from its axis, the
level plane of any object on the table from half its height. Each source proposes planes that the
others miss; planes proposed twice are kept once.
"""

import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ReflectionSymmetry,
    RotationSymmetry,
    SymmetrySlots,
)
from pipelines.geometry.transforms import unit
from pipelines.grasping.symmetries.region_shape import (
    face_directions,
    half_between_ends,
    halfway_up,
    level_directions,
)
from pipelines.grasping.symmetries.sources import NETWORK, SHAPE

SAME_START = np.radians(8.0), 0.004  # radians, metres; starts closer than both lead to one fit

SourcedPlane = tuple[Array, Array, int]  # normal, point, source


def candidate_planes(
    slots: SymmetrySlots,
    axis: RotationSymmetry,
    points: Array,
    normals: Array,
    table: Plane | None,
    allowed: int = NETWORK | SHAPE,
) -> tuple[list[ReflectionSymmetry], Indices]:
    """Return k candidate planes, each with its point nearest to the region's middle, and sources.

    The region has `points` (n, 3), metres, and unit `normals` (n, 3); all in the camera frame.
    `axis` is the best rotation axis, the normal of `table` points to the camera, `allowed` are the
    sources to use.
    """
    middle = points.mean(axis=0)
    proposed = [(slots.direction[k], slots.point[k], NETWORK) for k in REFLECTION_SLOTS]
    if allowed & SHAPE:
        first, last = _from_shape(axis, points, normals, table)
        proposed = [*first, *proposed, *last]
    chosen = [each for each in proposed if each[2] & allowed]
    normal = unit(np.array([direction for direction, _, _ in chosen]))
    offset = np.einsum("ki,ki->k", np.array([point for _, point, _ in chosen]) - middle, normal)
    foot = middle + offset[:, None] * normal  # point nearest to the middle
    planes = [ReflectionSymmetry(*each) for each in zip(normal, foot, strict=True)]
    sources = np.array([source for _, _, source in chosen])
    return merged_planes(planes, sources, *SAME_START)


def _from_shape(
    axis: RotationSymmetry, points: Array, normals: Array, table: Plane | None
) -> tuple[list[SourcedPlane], list[SourcedPlane]]:
    """Return planes from the region's shape, and planes positioned by the axis."""
    directions, proposed = face_directions(points, normals), []
    if table is not None:
        directions += level_directions(points, table)
        proposed.append((table.normal, halfway_up(points, table), SHAPE))
    across = [*directions, axis.direction]
    middles = half_between_ends(points, np.array(across))
    proposed += [(d, middle * d, SHAPE) for d, middle in zip(across, middles, strict=True)]
    # The middle of a half hidden object is not the middle of its seen part, but may be on the axis.
    return proposed, [(d, axis.point, SHAPE) for d in directions]


def merged_planes(
    planes: list[ReflectionSymmetry], sources: Indices, angle: float, offset: float
) -> tuple[list[ReflectionSymmetry], Indices]:
    """Return `planes` without those within `angle` (radians) and `offset` (metres) of earlier ones.

    Also the merged sources of each plane. `offset` is along the earlier plane's normal; `sources`
    (k,) are bits `NETWORK` and `SHAPE`.
    """
    normal = np.array([plane.normal for plane in planes]).reshape(-1, 3)
    point = np.array([plane.point for plane in planes]).reshape(-1, 3)
    kept, joined = _distinct(normal, point, sources, float(np.cos(angle)), offset)
    return [planes[number] for number in kept], joined


@compiled
def _distinct(
    normal: Array, point: Array, sources: Indices, cosine: float, offset: float
) -> tuple[Indices, Indices]:
    """Return the indices of the planes of `normal` and `point` (k, 3) that are kept, in order.

    Also the `sources` (k,) of each, merged with the sources of its duplicates.
    """
    kept, joined, count = np.empty(len(normal), np.int64), np.empty(len(normal), np.int64), 0
    for k in range(len(normal)):
        new = True
        for place in range(count):
            before = kept[place]
            alike, away = 0.0, 0.0
            for i in range(3):
                alike += normal[k, i] * normal[before, i]
                away += (point[k, i] - point[before, i]) * normal[before, i]
            if abs(alike) > cosine and abs(away) < offset:
                new = False
                joined[place] |= sources[k]
        if new:
            kept[count], joined[count] = k, sources[k]
            count += 1
    return kept[:count].copy(), joined[:count].copy()
