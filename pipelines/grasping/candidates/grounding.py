"""Ground predicted symmetries in what the camera sees: fit them, and critic how far to trust them.

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
from pipelines.geometry.transforms import rotation_about
from pipelines.grasping.candidates.axis_candidates import candidate_axes
from pipelines.grasping.candidates.decoding import in_observed_frustum
from pipelines.grasping.candidates.plane_evidence import RegionEvidence, trusted_planes
from pipelines.grasping.observation import RegionCloud, SceneCloud
from pipelines.grasping.ranking.point_critic import PointCritic

Array = NDArray[np.float64]

NUM_POINTS = 400  # of the region that are fitted
EVERY = 4  # so many-th of them is turned about each axis
TURNS = np.radians([60.0, 120.0, 180.0, 240.0, 300.0])

# Logistic regression of truth on (1, existence, support, consistency), `tools/calibrate_trust.py`.
WEIGHTS = {
    "rotation": (-24.5, 5.6, 3.0, 20.4),
    "sphere": (-13.6, 7.6, 18.3, 4.8),
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
        known = self.existence, self.support, self.consistency
        return float(expit(log_odds(self.symmetry.kind, *known)))


def log_odds(kind: str, existence: float, support: float, consistency: float) -> float:
    """Return the log odds that a symmetry of some `kind` is true; the rest as in `Evidence`."""
    constant, *slopes = WEIGHTS[kind]
    return constant + slopes[0] * existence + slopes[1] * support + slopes[2] * consistency


def ground_symmetries(
    slots: SymmetrySlots,
    region: RegionCloud,
    scene: SceneCloud,
    config: SelectionConfig,
    critic: PointCritic,
) -> SymmetrySlots:
    """Return `slots` fitted to `region`; existence becomes the confidence in each."""
    step = max(1, len(region) // NUM_POINTS)
    points, normals = region.points[::step].copy(), region.normals[::step].copy()
    axis = axis_evidence(slots, points, normals, scene, config)
    sphere = sphere_evidence(slots, points, normals, scene, config)
    known = RegionEvidence(slots, axis.symmetry, points, normals, region.mask, scene)
    planes = trusted_planes(known, config, critic)
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
    axes, feet = np.array([fit.direction for fit in fits]), np.array([fit.point for fit in fits])
    images = _turned(points[::EVERY], axes, feet)
    free = in_observed_frustum(images.reshape(-1, 3), scene, config).reshape(images.shape[:-1])
    shares = free.mean(axis=(0, 2))
    existence = float(slots.existence[ROTATION_SLOT])
    known = [
        (existence, fit.support, float(share)) for fit, share in zip(fits, shares, strict=True)
    ]
    best = max(range(len(fits)), key=lambda index: log_odds("rotation", *known[index]))
    return Evidence(RotationSymmetry(axes[best], feet[best]), *known[best])


def _turned(points: Array, axes: Array, feet: Array) -> Array:
    """Return (n, k, t, 3) `points` (n, 3) turned by `TURNS` about `axes` through `feet` (k, 3)."""
    turns = rotation_about(axes[:, None], TURNS)  # (k, t, 3, 3)
    shift = feet[:, None] - np.einsum("ktij,kj->kti", turns, feet)
    return np.asarray((points @ turns.reshape(-1, 3).T).reshape(-1, *shift.shape) + shift)


def sphere_evidence(
    slots: SymmetrySlots, points: Array, normals: Array, scene: SceneCloud, config: SelectionConfig
) -> Evidence[SphereSymmetry]:
    """Return the network's sphere, fitted."""
    fit = fit_sphere(slots.point[SPHERE_SLOT], points, normals)
    sphere = SphereSymmetry(fit.point)
    free = in_observed_frustum(sphere.counterpart(points), scene, config)
    existence = float(slots.existence[SPHERE_SLOT])
    return Evidence(sphere, existence, fit.support, float(free.mean()))
