"""Critic candidate mirror planes of a region by what the camera sees of it (D. 65).

A true plane maps the seen surface onto seen surface or behind it, never into observed free space;
it lies in the middle. The evidence is a row of numbers, and the points as the plane sees them; a
`PointCritic` makes a probability of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.numerics.fitting_sums import MATCH_NORMAL
from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ReflectionSymmetry,
    RotationSymmetry,
    SymmetrySlots,
)
from pipelines.geometry.symmetry_fitting import MIN_OVERLAP, fit_reflections
from pipelines.grasping.candidates.decoding import in_observed_frustum
from pipelines.grasping.candidates.mirror_views import MirrorImages, plane_rows, point_rows
from pipelines.grasping.candidates.plane_candidates import (
    candidate_planes,
    distinct,
    region_top,
)
from pipelines.grasping.observation import SceneCloud
from pipelines.grasping.ranking.point_critic import PointCritic

Array = NDArray[np.float64]

BESIDE = 0.008  # metres between an image and the nearest seen point: it is beside the surface
ON_SURFACE = 0.003  # metres along the normal: it lies on the surface
FACING = np.cos(np.radians(20.0))
LEVEL = np.cos(np.radians(25.0))
UNKNOWN_TILT = 0.7  # for a plane's cosine with the table's normal, where no table is known
SAME_FIT = np.radians(2.0), 0.001  # radians, metres
# Of planes nearer than this one is wrong, or follows from the other: no two of a bounded body's are
# parallel, and those that are listed stand at right angles, or at 60 degrees in a prism.
RIVALS = np.radians(50.0)

FEATURES = (
    "on_surface",
    "beside_surface",
    "consistency",
    "off_middle",
    "facing",
    "tilt",
    "level",
    "off_halfway",
    "size",
)


@dataclass(frozen=True)
class RegionEvidence:
    """What is known of a region before its planes are judged.

    Attributes:
        slots: the network's symmetries.
        axis: the best axis of rotation.
        points: (n, 3) of the region.
        normals: (n, 3).
        mask: (H, W) its pixels.
        scene: what the camera saw.
    """

    slots: SymmetrySlots
    axis: RotationSymmetry
    points: Array
    normals: Array
    mask: NDArray[np.bool_]
    scene: SceneCloud


def trusted_planes(
    region: RegionEvidence, config: SelectionConfig, critic: PointCritic
) -> list[tuple[ReflectionSymmetry, float]]:
    """Return at most three distinct planes with the confidence in each, most trusted first."""
    planes = fitted_planes(region)
    confidence = trust(planes, region, config, critic)
    order = np.argsort(-confidence, kind="stable")
    chosen = distinct([planes[i] for i in order], RIVALS)[: len(REFLECTION_SLOTS)]
    known = {id(planes[i]): float(confidence[i]) for i in order}
    return [(plane, known[id(plane)]) for plane in chosen]


def fitted_planes(region: RegionEvidence) -> list[ReflectionSymmetry]:
    """Return all candidates, and those that the seen surface fits better beside them."""
    points, normals, table = region.points, region.normals, region.scene.plane
    starts = candidate_planes(region.slots, region.axis, points, normals, table)
    fits = fit_reflections(starts, points, normals)
    better = [ReflectionSymmetry(f.direction, f.point) for f in fits if f.support >= MIN_OVERLAP]
    return distinct([*starts, *better], *SAME_FIT)


def trust(
    planes: list[ReflectionSymmetry],
    region: RegionEvidence,
    config: SelectionConfig,
    critic: PointCritic,
) -> Array:
    """Return the probability (k,) that `planes` are true."""
    mirrored = MirrorImages.of(planes, region.points, region.normals)
    return critic.trust(
        point_rows(planes, mirrored, region.mask, region.scene),
        plane_rows(planes, region.points, region.scene),
        plane_features(planes, mirrored, region, config).astype(np.float32),
    )


def plane_features(
    planes: list[ReflectionSymmetry],
    mirrored: MirrorImages,
    region: RegionEvidence,
    config: SelectionConfig,
) -> Array:
    """Return (k, f) the evidence for each plane, in the order of `FEATURES`.

    on_surface, beside_surface: shares of the mirror images that lie on the seen surface, and that
    lie next to it but not on it. consistency: share that is not in observed free space.
    off_middle: distance to the middle of what is seen, in extents along the normal. facing: share
    of the surface that faces along the normal. tilt, level: cosine with the table's normal, and
    whether they are one. off_halfway: of level planes, distance to half the height, in heights.
    size: metres.
    """
    points, scene = region.points, region.scene
    normal = np.array([plane.normal for plane in planes])
    images = mirrored.images
    free = in_observed_frustum(images.reshape(-1, 3), scene, config).reshape(images.shape[:2])
    on_surface, beside = _meetings(mirrored)
    low, _, high = mirrored.sides.T
    off_middle = np.minimum(np.abs(low + high) / np.maximum(high - low, 1e-3), 1.0)
    facing = (np.abs(region.normals @ normal.T) > FACING).mean(axis=0)
    tilt, off_halfway = _against_table(planes, normal, region)
    size = np.full(len(planes), np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    columns = [on_surface, beside, free.mean(axis=1), off_middle, facing]
    columns += [tilt, tilt > LEVEL, off_halfway, size]
    return np.stack(columns, axis=1).astype(np.float64)


def _meetings(mirrored: MirrorImages) -> tuple[Array, Array]:
    """Return (k,) the shares of images on the seen surface, and beside it."""
    meets = (np.abs(mirrored.gap) < ON_SURFACE) & (mirrored.agreement > MATCH_NORMAL)
    near = mirrored.distance < BESIDE
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
