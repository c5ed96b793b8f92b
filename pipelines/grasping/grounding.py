"""Ground predicted symmetries in what the camera sees: fit them, and judge how far to trust them.

The network tells roughly where a region's symmetries are; the measured points tell exactly, and
whether they are there at all: a true symmetry maps the seen surface onto seen surface or behind
it, never into observed free space (D. 31).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.configs import SelectionConfig
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ROTATION_SLOT,
    SPHERE_SLOT,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
    SymmetrySlots,
)
from pipelines.geometry.symmetry_fitting import (
    MIN_OVERLAP,
    Fit,
    fit_reflection,
    fit_rotation,
    fit_sphere,
)
from pipelines.geometry.transforms import unit
from pipelines.grasping.decoding import in_observed_frustum
from pipelines.grasping.observation import RegionCloud, SceneCloud

Array = NDArray[np.float64]

NUM_POINTS = 400  # of the region that are fitted
TURNS = np.radians([60.0, 120.0, 180.0, 240.0, 300.0])
HEAD_START = 0.05  # of support, for the network's own axis over the other candidates
SAME_ANGLE = np.radians(15.0)  # planes closer than both are one
SAME_OFFSET = 0.008  # metres
LEVEL_ANGLE = np.radians(25.0)
TOP_PERCENTILE = 97.0  # of a region's heights, against flying pixels

# Logistic regression of truth on (1, existence, support, consistency), on held-out scenes of the
# training set. A mirror plane whose far side is hidden is a case of its own, and so is the level
# plane halfway up what stands on the table.
WEIGHTS = {
    "reflection": np.array([-19.9, -0.2, 4.1, 18.0]),
    "hidden": np.array([-6.8, 0.5, -0.1, 6.1]),
    "level": np.array([-9.4, 2.0, 0.1, 8.7]),
    "rotation": np.array([-11.1, 5.2, 7.5, 5.1]),
    "sphere": np.array([-5.1, 5.5, 8.5, 0.5]),
}


@dataclass(frozen=True)
class Evidence:
    """One fitted symmetry and what speaks for it, each 0 to 1.

    Attributes:
        symmetry: camera frame.
        existence: what the network says; 0 for a candidate that it did not name.
        support: share of the seen surface that the fit explains.
        consistency: share of images that lie on or behind the observed surface.
        case: whose weights turn the evidence into confidence.
    """

    symmetry: Symmetry
    existence: float
    support: float
    consistency: float
    case: str

    @property
    def confidence(self) -> float:
        """Probability that the symmetry is true."""
        features = np.array([1.0, self.existence, self.support, self.consistency])
        return float(1.0 / (1.0 + np.exp(-features @ WEIGHTS[self.case])))


def ground_symmetries(
    slots: SymmetrySlots, region: RegionCloud, scene: SceneCloud, config: SelectionConfig
) -> SymmetrySlots:
    """Return `slots` fitted to `region`; existence becomes the confidence in each."""
    step = max(1, len(region) // NUM_POINTS)
    points, normals = region.points[::step], region.normals[::step]
    found = SymmetrySlots.empty()
    planes = distinct_planes(list(plane_evidence(slots, points, normals, scene, config)))
    best = [axis_evidence(slots, points, normals, scene, config)]
    best.append(sphere_evidence(slots, points, normals, scene, config))
    chosen = [*zip(REFLECTION_SLOTS, planes, strict=False)]
    chosen += zip((ROTATION_SLOT, SPHERE_SLOT), best, strict=True)
    for slot, evidence in chosen:
        found.existence[slot] = evidence.confidence
        found.point[slot] = evidence.symmetry.point
        found.direction[slot] = evidence.symmetry.direction
    return found


def plane_evidence(
    slots: SymmetrySlots, points: Array, normals: Array, scene: SceneCloud, config: SelectionConfig
) -> Iterator[Evidence]:
    """Yield the network's planes and those across the region's level principal axes, fitted."""
    starts = [(slots.direction[k], slots.point[k], slots.existence[k]) for k in REFLECTION_SLOTS]
    centre = np.median(slots.point[: SPHERE_SLOT + 1], axis=0)
    starts += [(axis, centre, 0.0) for axis in level_axes(points, scene)]
    for direction, point, existence in starts:
        fit = fit_reflection(ReflectionSymmetry(direction, point), points, normals)
        plane = ReflectionSymmetry(fit.direction, fit.point)
        consistency = _consistency(plane.counterpart(points), scene, config)
        case = "reflection" if fit.support >= MIN_OVERLAP else "hidden"
        yield Evidence(plane, float(existence), fit.support, consistency, case)
    if scene.plane is not None:
        yield level_evidence(slots, points, scene.plane, scene, config)


def level_evidence(
    slots: SymmetrySlots, points: Array, table: Plane, scene: SceneCloud, config: SelectionConfig
) -> Evidence:
    """Return the plane halfway between the table and the region's top: cans and boxes have it.

    Its lower half is hidden, so the network's word for it is that of its most level plane.
    """
    up = table.normal
    top = float(np.percentile(table.height(points), TOP_PERCENTILE))
    foot = np.median(points, axis=0)
    plane = ReflectionSymmetry(up, foot + (top / 2.0 - float(table.height(foot))) * up)
    cosine = np.abs(slots.direction[list(REFLECTION_SLOTS)] @ up)
    named = np.where(cosine > np.cos(LEVEL_ANGLE), slots.existence[list(REFLECTION_SLOTS)], 0.0)
    low = float((table.height(points) < top / 2.0).mean())
    consistency = _consistency(plane.counterpart(points), scene, config)
    return Evidence(plane, float(named.max()), low, consistency, "level")


def axis_evidence(
    slots: SymmetrySlots, points: Array, normals: Array, scene: SceneCloud, config: SelectionConfig
) -> Evidence:
    """Return the best axis of the network's, the table's normal and the principal axes, fitted."""
    starts = [slots.direction[ROTATION_SLOT], *principal_axes(points).T]
    if scene.plane is not None:
        starts.append(scene.plane.normal)
    centre = slots.point[ROTATION_SLOT]

    def fitted(direction: Array) -> Fit:
        return fit_rotation(RotationSymmetry(direction, centre), points, normals)

    fit = _best(starts, fitted)
    axis = RotationSymmetry(fit.direction, fit.point)
    images = np.concatenate([axis.turn(points, angle) for angle in TURNS])
    existence = float(slots.existence[ROTATION_SLOT])
    consistency = _consistency(images, scene, config)
    return Evidence(axis, existence, fit.support, consistency, "rotation")


def sphere_evidence(
    slots: SymmetrySlots, points: Array, normals: Array, scene: SceneCloud, config: SelectionConfig
) -> Evidence:
    """Return the network's sphere, fitted."""
    fit = fit_sphere(slots.point[SPHERE_SLOT], points, normals)
    sphere = SphereSymmetry(fit.point)
    consistency = _consistency(sphere.counterpart(points), scene, config)
    existence = float(slots.existence[SPHERE_SLOT])
    return Evidence(sphere, existence, fit.support, consistency, "sphere")


def _best(starts: list[Array], fitted: Callable[[Array], Fit]) -> Fit:
    fits = [fitted(start) for start in starts]
    support = [fit.support + (HEAD_START if i == 0 else 0.0) for i, fit in enumerate(fits)]
    return fits[int(np.argmax(support))]


def _consistency(images: Array, scene: SceneCloud, config: SelectionConfig) -> float:
    return float(in_observed_frustum(images, scene, config).mean())


def principal_axes(points: Array) -> Array:
    """Return the (3, 3) principal axes of `points` (n, 3) as columns."""
    vectors: Array = np.linalg.eigh(np.cov(points.T))[1]
    return vectors


def level_axes(points: Array, scene: SceneCloud) -> list[Array]:
    """Return the principal axes of `points` in the table's plane; in space if there is none."""
    if scene.plane is None:
        return list(principal_axes(points).T)
    up = scene.plane.normal
    level = points - np.outer(points @ up, up)
    longest = principal_axes(level)[:, 2]
    return [longest, unit(np.cross(up, longest))]


def distinct_planes(candidates: list[Evidence]) -> list[Evidence]:
    """Return `candidates`, most trusted first, those left out that repeat a better one."""
    kept: list[Evidence] = []
    for candidate in sorted(candidates, key=lambda each: -each.confidence):
        if not any(_same_plane(candidate.symmetry, other.symmetry) for other in kept):
            kept.append(candidate)
    return kept


def _same_plane(first: Symmetry, second: Symmetry) -> bool:
    cosine = abs(float(first.direction @ second.direction))
    offset = abs(float((first.point - second.point) @ second.direction))
    return cosine > np.cos(SAME_ANGLE) and offset < SAME_OFFSET
