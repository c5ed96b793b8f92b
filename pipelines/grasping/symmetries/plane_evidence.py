"""Mirror planes of a region: candidates fitted to the seen surface, selected by a critic (D. 65).

A true plane is in the middle and maps the seen surface onto or behind seen surface, never into
observed free space. The plane critic, a `PointCritic`, turns this evidence into a probability.
"""

import numpy as np

from pipelines.array_types import Array, Indices, Singles
from pipelines.geometry.numerics.fitting_sums import MATCH_NORMAL
from pipelines.geometry.symmetry import REFLECTION_SLOTS, ReflectionSymmetry, RotationSymmetry
from pipelines.geometry.symmetry_fitting import fit_reflections
from pipelines.grasping.critics.point_critic import PointCritic
from pipelines.grasping.symmetries.mirror_views import MirrorImages, plane_features, point_features
from pipelines.grasping.symmetries.observed_frustum import in_observed_frustum
from pipelines.grasping.symmetries.plane_candidates import candidate_planes, merged_planes
from pipelines.grasping.symmetries.region_evidence import RegionEvidence
from pipelines.grasping.symmetries.region_shape import region_top

# All chosen by eye, except RIVALS (D. 65); the shipped weights were trained with these values.
BESIDE = 0.008  # metres to the nearest seen point, from which an image is next to the surface
ON_SURFACE = 0.003  # metres along that point's normal, up to which an image is on the surface
FACING = np.cos(np.radians(20.0))
LEVEL = np.cos(np.radians(25.0))
UNKNOWN_TILT = 0.7  # replaces the cosine with the table's normal if no table is known
SAME_FIT = np.radians(2.0), 0.001  # radians, metres
# Of two planes at a smaller angle, one is wrong or follows from the other: no two planes of a
# bounded body are parallel; listed planes are at right angles, or at 60 degrees in a prism.
RIVALS = np.radians(50.0)
LEAST_TOP = 0.01  # metres; `off_halfway` of a lower region is in this unit

FEATURES = (
    "on_surface",  # share of the mirror images on the seen surface
    "beside_surface",  # share next to the seen surface, but not on it
    "consistency",  # share outside of observed free space
    "off_middle",  # distance to the middle of the seen points, in half extents along the normal
    "facing",  # share of the surface that faces along the normal
    "tilt",  # cosine with the table's normal
    "level",  # whether the plane is parallel to the table
    "off_halfway",  # distance of level planes to half the region's height, in heights
    "size",  # extent of the region, metres
)


def likely_planes(
    region: RegionEvidence, axis: RotationSymmetry, critic: PointCritic
) -> list[tuple[ReflectionSymmetry, float, int]]:
    """Return at most three distinct planes, the most likely first.

    Each plane comes with its confidence and its source. `axis`: the region's most likely axis.
    """
    planes, sources = fitted_planes(region, axis)
    confidence = critic.probability(*plane_critic_inputs(planes, region))
    order = np.argsort(-confidence, kind="stable")
    chosen, _ = merged_planes([planes[i] for i in order], sources[order], RIVALS, np.inf)
    scored = {id(planes[i]): (float(confidence[i]), int(sources[i])) for i in order}
    return [(plane, *scored[id(plane)]) for plane in chosen[: len(REFLECTION_SLOTS)]]


def fitted_planes(
    region: RegionEvidence, axis: RotationSymmetry
) -> tuple[list[ReflectionSymmetry], Indices]:
    """Return all k candidate planes, their fits to the seen surface, and the sources.

    Alike planes are merged, with the sources of all. `axis`: the region's most likely axis.
    """
    points, normals, table = region.points, region.normals, region.scene.plane
    starts, sources = candidate_planes(region.slots, axis, points, normals, table, region.allowed)
    fits = fit_reflections(starts, points, normals)
    better = [ReflectionSymmetry(fit.direction, fit.point) for fit in fits]
    return merged_planes([*starts, *better], np.concatenate([sources, sources]), *SAME_FIT)


def plane_critic_inputs(
    planes: list[ReflectionSymmetry], region: RegionEvidence
) -> tuple[Singles, Singles, Singles]:
    """Return the plane critic's features of k planes: (k, 128, 14), (k, 3) and (k, 9)."""
    mirrored = MirrorImages.of(planes, region.points, region.normals)
    columns = _evidence(planes, mirrored, region)
    return (
        point_features(planes, mirrored, region.mask, region.scene),
        plane_features(planes, region.points, region.scene),
        np.stack([columns[name] for name in FEATURES], axis=1).astype(np.float32),
    )


def _evidence(
    planes: list[ReflectionSymmetry], mirrored: MirrorImages, region: RegionEvidence
) -> dict[str, Array]:
    """Return the `FEATURES` (k,) of k planes by name."""
    points, scene = region.points, region.scene
    normal = np.array([plane.normal for plane in planes])
    images = mirrored.images
    free = in_observed_frustum(images.reshape(-1, 3), scene).reshape(images.shape[:2])
    near = mirrored.distance < BESIDE
    meets = (np.abs(mirrored.gap) < ON_SURFACE) & (mirrored.agreement > MATCH_NORMAL)
    tilt, off_halfway = _against_table(planes, normal, region)
    return {
        "on_surface": (near & meets).mean(axis=1),
        "beside_surface": (near & ~meets).mean(axis=1),
        "consistency": free.mean(axis=1),
        "off_middle": mirrored.off_middle,
        "facing": (np.abs(region.normals @ normal.T) > FACING).mean(axis=0),
        "tilt": tilt,
        "level": tilt > LEVEL,
        "off_halfway": off_halfway,
        "size": np.full(len(planes), np.linalg.norm(points.max(axis=0) - points.min(axis=0))),
    }


def _against_table(
    planes: list[ReflectionSymmetry], normal: Array, region: RegionEvidence
) -> tuple[Array, Array]:
    """Return the cosine (k,) with the table's normal, and the distance (k,) to half the height."""
    table = region.scene.plane
    if table is None:
        return np.full(len(planes), UNKNOWN_TILT), np.zeros(len(planes))
    tilt = np.abs(normal @ table.normal)
    top = region_top(region.points, table)
    height = table.height(np.array([plane.point for plane in planes]))
    off = np.abs(height - top / 2.0) / max(top, LEAST_TOP)
    return tilt, np.where(tilt > LEVEL, np.minimum(off, 1.0), 0.0)
