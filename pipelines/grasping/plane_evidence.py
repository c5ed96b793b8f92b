"""Judge candidate mirror planes of a region by what the camera sees of it (D. 65).

A true plane maps the seen surface onto seen surface or behind it, never into observed free space;
it lies in the middle; and what looks like it in the network's eyes counts too. The evidence is a
row of numbers, the trust a logistic regression on them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import expit

from pipelines.configs import SelectionConfig
from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ROTATION_SLOT,
    ReflectionSymmetry,
    RotationSymmetry,
    SymmetrySlots,
)
from pipelines.geometry.symmetry_fitting import MIN_OVERLAP, face_alike, fit_reflections
from pipelines.grasping.decoding import in_observed_frustum
from pipelines.grasping.observation import SceneCloud
from pipelines.grasping.plane_candidates import (
    END_PERCENTILES,
    candidate_planes,
    distinct,
    region_top,
)

Array = NDArray[np.float64]

NAMED_ANGLE = np.radians(14.0)  # how far off the network's planes are
NAMED_OFFSET = 0.010  # metres
BESIDE = 0.008  # metres between an image and the nearest seen point: it is beside the surface
ON_SURFACE = 0.003  # metres along the normal: it lies on the surface
FACING = np.cos(np.radians(20.0))
LEVEL = np.cos(np.radians(25.0))
UNKNOWN_TILT = 0.7  # for a plane's cosine with the table's normal, where no table is known
SAME_FIT = np.radians(2.0), 0.001  # radians, metres
# Of a bounded body no two mirror planes are parallel, and at most three are listed.
SAME_PLANE = np.radians(25.0)

FEATURES = (
    "named",
    "on_surface",
    "beside_surface",
    "consistency",
    "off_middle",
    "facing",
    "tilt",
    "level",
    "off_halfway",
    "axis",
    "axis_inside",
    "turns",
    "size",
)
# Logistic regression of truth on FEATURES, `python docs/calibrate_trust.py`: objects that the
# networks never saw, in the regions that the detector finds.
BIAS = -26.15
WEIGHTS = np.array(
    [1.04, 4.73, -1.98, 20.1, -2.13, 5.05, -3.63, 4.99, -32.99, -1.96, 1.27, 1.11, 16.56]
)


@dataclass(frozen=True)
class RegionEvidence:
    """What is known of a region before its planes are judged.

    Attributes:
        slots: the network's symmetries.
        axis: the best axis of rotation.
        axis_confidence: in it.
        points: (n, 3) of the region.
        normals: (n, 3).
        scene: what the camera saw.
    """

    slots: SymmetrySlots
    axis: RotationSymmetry
    axis_confidence: float
    points: Array
    normals: Array
    scene: SceneCloud


def trusted_planes(
    region: RegionEvidence, config: SelectionConfig
) -> list[tuple[ReflectionSymmetry, float]]:
    """Return at most three distinct planes with the confidence in each, most trusted first."""
    planes = fitted_planes(region)
    confidence = trust(plane_features(planes, region, config))
    order = np.argsort(-confidence, kind="stable")
    chosen = distinct([planes[i] for i in order], SAME_PLANE)[: len(REFLECTION_SLOTS)]
    known = {id(planes[i]): float(confidence[i]) for i in order}
    return [(plane, known[id(plane)]) for plane in chosen]


def fitted_planes(region: RegionEvidence) -> list[ReflectionSymmetry]:
    """Return all candidates, and those that the seen surface fits better beside them."""
    points, normals, table = region.points, region.normals, region.scene.plane
    starts = candidate_planes(region.slots, region.axis.axis, points, normals, table)
    fits = fit_reflections(starts, points, normals)
    better = [ReflectionSymmetry(f.direction, f.point) for f in fits if f.support >= MIN_OVERLAP]
    return distinct([*starts, *better], *SAME_FIT)


def trust(features: Array) -> Array:
    """Return the probability (k,) that planes with `features` (k, f) are true."""
    return np.asarray(expit(features @ WEIGHTS + BIAS))


def plane_features(
    planes: list[ReflectionSymmetry], region: RegionEvidence, config: SelectionConfig
) -> Array:
    """Return (k, f) the evidence for each plane, in the order of `FEATURES`.

    named: the network's word for a plane like it. on_surface, beside_surface: shares of the mirror
    images that lie on the seen surface, and that lie next to it but not on it. consistency: share
    that is not in observed free space. off_middle: distance to the middle of what is seen, in
    extents along the normal. facing: share of the surface that faces along the normal. tilt,
    level: cosine with the table's normal, and whether they are one. off_halfway: of level planes,
    distance to half the height, in heights. axis, axis_inside: confidence in the axis, and the
    same for planes that hold it. turns: the network's word for a rotation. size: metres.
    """
    points, scene = region.points, region.scene
    normal = np.array([plane.normal for plane in planes])
    offset = np.array([plane.point @ plane.normal for plane in planes])
    side = points @ normal.T - offset  # (n, k)
    images = points - 2.0 * side.T[..., None] * normal[:, None]  # (k, n, 3)
    free = in_observed_frustum(images.reshape(-1, 3), scene, config).reshape(images.shape[:2])
    on_surface, beside = _meetings(images, normal, region)
    low, high = np.percentile(side, END_PERCENTILES, axis=0)
    off_middle = np.minimum(np.abs(low + high) / np.maximum(high - low, 1e-3), 1.0)
    facing = (np.abs(region.normals @ normal.T) > FACING).mean(axis=0)
    tilt, off_halfway = _against_table(planes, normal, region)
    known = np.full(len(planes), region.axis_confidence)
    inside = np.abs(normal @ region.axis.axis) < np.sin(np.radians(20.0))
    turns = np.full(len(planes), region.slots.existence[ROTATION_SLOT])
    size = np.full(len(planes), np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    columns = [_named(normal, offset, region.slots), on_surface, beside, free.mean(axis=1)]
    columns += [off_middle, facing, tilt, tilt > LEVEL, off_halfway]
    columns += [known, known * inside, turns, size]
    return np.stack(columns, axis=1).astype(np.float64)


def _named(normal: Array, offset: Array, slots: SymmetrySlots) -> Array:
    """Return (k,) the existence of the network's plane that is most like each."""
    rows = list(REFLECTION_SLOTS)
    cosine = np.abs(normal @ slots.direction[rows].T)
    apart = np.abs(normal @ slots.point[rows].T - offset[:, None])
    unlike = (1.0 - cosine) / (1.0 - np.cos(NAMED_ANGLE)) + (apart / NAMED_OFFSET) ** 2
    return np.asarray((np.exp(-unlike) * slots.existence[rows]).max(axis=1))


def _meetings(images: Array, normal: Array, region: RegionEvidence) -> tuple[Array, Array]:
    """Return (k,) the shares of images on the seen surface, and beside it."""
    distance, nearest = KDTree(region.points).query(images)
    target = region.normals[nearest]
    gap = np.abs(np.einsum("kni,kni->kn", target, images - region.points[nearest]))
    meets = (gap < ON_SURFACE) & face_alike(region.normals, target, normal)
    near = distance < BESIDE
    return (near & meets).mean(axis=1), (near & ~meets).mean(axis=1)


def _against_table(
    planes: list[ReflectionSymmetry], normal: Array, region: RegionEvidence
) -> tuple[Array, Array]:
    """Return (k,) the cosine with the table's normal, and how far off half the height."""
    table = region.scene.plane
    if table is None:
        return np.full(len(planes), UNKNOWN_TILT), np.zeros(len(planes))
    tilt = np.abs(normal @ table.normal)
    top = region_top(region.points, table)
    height = table.height(np.array([plane.point for plane in planes]))
    off = np.abs(height - top / 2.0) / max(top, 0.01)
    return tilt, np.where(tilt > LEVEL, np.minimum(off, 1.0), 0.0)
