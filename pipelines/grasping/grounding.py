"""Ground predicted symmetries in what the camera sees: fit them, and judge how far to trust them.

The network tells roughly where a region's symmetries are; the measured points tell exactly, and
whether they are there at all: a true symmetry maps the seen surface onto seen surface or behind
it, never into observed free space (D. 31).
"""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from pipelines.configs import SelectionConfig
from pipelines.geometry.symmetry import (
    REFLECTION_SLOTS,
    ROTATION_SLOT,
    SPHERE_SLOT,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
    SymmetrySlots,
)
from pipelines.geometry.symmetry_fitting import fit_rotations, fit_sphere
from pipelines.grasping.axis_candidates import candidate_axes
from pipelines.grasping.decoding import in_observed_frustum
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.plane_evidence import RegionEvidence, trusted_planes
from pipelines.grasping.point_judge import PointJudge

Array = NDArray[np.float64]

NUM_POINTS = 400  # of the region that are fitted
EVERY = 4  # so many-th of them is turned about each axis
TURNS = np.radians([60.0, 120.0, 180.0, 240.0, 300.0])

# Logistic regression of truth on (1, existence, support, consistency), `docs/calibrate_trust.py`.
WEIGHTS = {
    "rotation": np.array([-31.2, 6.7, 3.4, 26.4]),
    "sphere": np.array([-18.3, 5.9, 19.2, 9.8]),
}


Turned = TypeVar("Turned", RotationSymmetry, SphereSymmetry)


@dataclass(frozen=True)
class Evidence(Generic[Turned]):
    """One fitted axis or centre and what speaks for it, each 0 to 1.

    Attributes:
        symmetry: camera frame.
        existence: what the network says.
        support: share of the seen surface that the fit explains.
        consistency: share of images that lie on or behind the observed surface.
    """

    symmetry: Turned
    existence: float
    support: float
    consistency: float

    @property
    def confidence(self) -> float:
        """Probability that the symmetry is true."""
        features = np.array([1.0, self.existence, self.support, self.consistency])
        return float(expit(features @ WEIGHTS[self.symmetry.kind]))


def ground_symmetries(
    slots: SymmetrySlots,
    region: RegionCloud,
    scene: SceneCloud,
    config: SelectionConfig,
    judge: PointJudge,
) -> SymmetrySlots:
    """Return `slots` fitted to `region`; existence becomes the confidence in each."""
    step = max(1, len(region) // NUM_POINTS)
    points, normals = region.points[::step], region.normals[::step]
    axis = axis_evidence(slots, points, normals, scene, config)
    sphere = sphere_evidence(slots, points, normals, scene, config)
    known = RegionEvidence(slots, axis.symmetry, points, normals, region.mask, scene)
    planes = trusted_planes(known, config, judge)
    chosen: list[tuple[int, Symmetry, float]] = [
        (slot, plane, trust) for slot, (plane, trust) in zip(REFLECTION_SLOTS, planes, strict=False)
    ]
    chosen.append((ROTATION_SLOT, axis.symmetry, axis.confidence))
    chosen.append((SPHERE_SLOT, sphere.symmetry, sphere.confidence))
    found = SymmetrySlots.empty()
    for slot, symmetry, confidence in chosen:
        found.existence[slot] = confidence
        found.point[slot], found.direction[slot] = symmetry.point, symmetry.direction
    return found


def axis_evidence(
    slots: SymmetrySlots, points: Array, normals: Array, scene: SceneCloud, config: SelectionConfig
) -> Evidence[RotationSymmetry]:
    """Return the axis, of all candidates fitted, that is trusted most."""
    starts = candidate_axes(slots, points, normals, scene.plane)
    fits = fit_rotations(starts, points, normals)
    axes = [RotationSymmetry(fit.direction, fit.point) for fit in fits]
    images = np.array([axis.turn(points[::EVERY], TURNS) for axis in axes])
    free = in_observed_frustum(images.reshape(-1, 3), scene, config).reshape(len(axes), -1)
    existence = float(slots.existence[ROTATION_SLOT])
    found = [
        Evidence(axis, existence, fit.support, float(share))
        for axis, fit, share in zip(axes, fits, free.mean(axis=1), strict=True)
    ]
    return max(found, key=lambda evidence: evidence.confidence)


def sphere_evidence(
    slots: SymmetrySlots, points: Array, normals: Array, scene: SceneCloud, config: SelectionConfig
) -> Evidence[SphereSymmetry]:
    """Return the network's sphere, fitted."""
    fit = fit_sphere(slots.point[SPHERE_SLOT], points, normals)
    sphere = SphereSymmetry(fit.point)
    free = in_observed_frustum(sphere.counterpart(points), scene, config)
    existence = float(slots.existence[SPHERE_SLOT])
    return Evidence(sphere, existence, fit.support, float(free.mean()))
