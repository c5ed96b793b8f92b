"""Mirror planes of one body: consistent sets, the plane across an axis, the best three."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.mesh_symmetry.detection.symmetry_search import (
    FINAL_SAMPLES,
    FINE_SCALES,
    refined_planes,
)
from pipelines.mesh_symmetry.detection.symmetry_verification import SurfaceFit
from pipelines.mesh_symmetry.detection.unit_surface import UnitSurface, fit_of_plane

Accepted = tuple[Array, SurfaceFit]  # a plane (nx, ny, nz, d) and its fit

ACROSS_COSINE = float(np.cos(np.radians(5.0)))  # between an axis and the normal of a plane across
CLOSEST_PLANES = float(np.radians(20.0))  # at a smaller angle, planes imply more than eight planes
GROUP_TOLERANCE = float(np.radians(4.0))  # of the angle between two planes
GROUP_ROOM = 1.5  # factor on the limits of implied planes
MISS_LIMITS = ("max_mean", "max_p95", "max_p99", "max_error")
WIDEST = 98.0  # percentile of the distances from the axis
ENDS_FLOOR = 0.001  # of the diameter; smaller differences are due to tessellation
MAX_ENDS = 0.02  # of the width; largest difference of the ends of a revolved body
FACING_POWER = 8  # exponent of the cosine between a face's normal and the plane's


def consistent_planes(
    shape: UnitSurface, planes: Sequence[Accepted], config: AnnotateSymmetryConfig
) -> list[Accepted]:
    """Return the planes, best first, without planes that contradict a better plane.

    Two mirrors imply a turn by twice their angle, and all images of the two. A loose plane next to
    a true one, as a plane next to the spout of a jug, fails this test.
    """
    kept: list[Accepted] = []
    for plane, fit in planes:
        if all(_form_a_group(shape, better, plane, config) for better, _ in kept):
            kept.append((plane, fit))
    return kept


def _form_a_group(
    shape: UnitSurface, first: Array, second: Array, config: AnnotateSymmetryConfig
) -> bool:
    """Return whether the planes (4,) implied by two planes hold, within wider limits.

    Parallel mirrors imply a translation, which no bounded object has.
    """
    between = float(np.arccos(np.clip(abs(first[:3] @ second[:3]), 0.0, 1.0)))
    if between < CLOSEST_PLANES:
        return False
    order = _order(between, config.max_order)
    if order is None:
        return False
    wider = replace(
        config,
        **{name: GROUP_ROOM * getattr(config, name) for name in MISS_LIMITS},
        min_agreement=config.min_agreement / GROUP_ROOM,
    )
    for _ in range(order - 2):
        first, second = second, _mirrored(first, second)
        if not fit_of_plane(shape, second, shape.samples).holds(wider):
            return False
    return True


def _order(between: float, most: int) -> int | None:
    """Return the least number of planes through a line that contain two planes; None if too many.

    Such planes are pi / order apart; two of them may be a multiple of that apart, as `between`.
    """
    for order in range(2, most + 1):
        steps = round(between * order / np.pi)
        is_least = math.gcd(steps, order) == 1
        if is_least and abs(between - steps * np.pi / order) <= GROUP_TOLERANCE:
            return order
    return None


def _mirrored(plane: Array, mirror: Array) -> Array:
    """Return the image of `plane` (4,) in `mirror` (4,)."""
    cosine = float(plane[:3] @ mirror[:3])
    return np.append(plane[:3] - 2.0 * cosine * mirror[:3], plane[3] - 2.0 * cosine * mirror[3])


def plane_across(
    shape: UnitSurface, axis: Array, accepted: Sequence[Accepted], config: AnnotateSymmetryConfig
) -> list[Accepted]:
    """Return the plane perpendicular to the continuous axis, if it is a mirror plane.

    The planes through the axis follow from the axis, and no other plane is possible.
    """
    arm = shape.samples.points - axis[3:]
    across = np.linalg.norm(np.cross(arm, axis[:3]), axis=1)
    limit = float(np.hypot(ENDS_FLOOR, MAX_ENDS * 2.0 * np.percentile(across, WIDEST)))
    for plane, fit in accepted:
        if abs(plane[:3] @ axis[:3]) > ACROSS_COSINE and fit.miss <= limit:
            return [(plane, fit)]
    # Halfway between the ends: if a lid is missing, the plane does not pass through the centroid.
    height = shape.samples.points @ axis[:3]
    for offset in (0.0, (height.min() + height.max()) / 2.0):
        start = np.append(axis[:3], offset)[None]
        plane = refined_planes(shape, start, FINE_SCALES, FINAL_SAMPLES)[0]
        fit = fit_of_plane(shape, plane, shape.samples)
        is_across = abs(plane[:3] @ axis[:3]) > ACROSS_COSINE
        if is_across and fit.miss <= limit and fit.holds(config):
            return [(plane, fit)]
    return []


def best_planes(
    shape: UnitSurface, accepted: Sequence[Accepted], config: AnnotateSymmetryConfig
) -> list[Accepted]:
    """Return at most `max_planes` planes: the most orthogonal set, with faces along the normals.

    A cube has nine planes, the network three slots. Among equally orthogonal triples, the triple
    parallel to faces is best: its mirrored points face each other and can be grasped.
    """
    if len(accepted) <= config.max_planes:
        return list(accepted)
    normals = np.stack([plane[:3] for plane, _ in accepted])
    facing = np.mean(np.abs(shape.samples.normals @ normals.T) ** FACING_POWER, axis=0)
    overlap = np.square(normals @ normals.T)

    def cost(chosen: tuple[int, ...]) -> tuple[float, float]:
        pairs = sum(float(overlap[i, j]) for i, j in combinations(chosen, 2))
        return round(pairs, 1), -float(facing[list(chosen)].sum())

    best = min(combinations(range(len(accepted)), config.max_planes), key=cost)
    return [accepted[index] for index in best]
