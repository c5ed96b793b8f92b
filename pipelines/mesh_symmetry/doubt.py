"""Doubt of an annotation: how near its decisions were to the opposite decisions (D. 42).

Every accepted symmetry and every rejected candidate is measured again on new samples. Its strain is
the factor on the annotator's limits with which the symmetry would just hold: up to 1 it holds. The
doubt is the strain for an accepted symmetry and 1 / strain for a rejected candidate, at most its
roundness; an object has the doubt of its most doubtful decision.
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.mesh_symmetry.detection.symmetry_refinement import robust_sphere
from pipelines.mesh_symmetry.detection.symmetry_verification import VERIFICATION_ANGLES, SurfaceFit
from pipelines.mesh_symmetry.detection.unit_surface import UnitSurface, fit_of_plane, fit_of_turn
from pipelines.mesh_symmetry.surface.canonical_pose import CanonicalPose

NUM_SURFACE, NUM_SAMPLES = 10_000, 800
SPHERE_ANGLES = VERIFICATION_ANGLES[::3]
IMPLIED_COSINE = float(np.cos(np.radians(7.0)))  # candidates this near a symmetry follow from it
IMPLIED_OFFSET = 0.03  # of the diameter
STRAINS = np.geomspace(1 / 32, 32, 513).tolist()  # steps of 1.4 %
NUM_MEASURED, NUM_REPORTED = 5, 3  # rejected candidates
LIKELY = 0.5  # nearness from which a sphere is reported, since spheres are not searched


@dataclass(frozen=True)
class Measure:
    """The fit of one symmetry to a mesh."""

    strain: float  # factor on the limits with which the symmetry would just hold; up to 1 it holds
    error: float  # dense symmetry error of the surface against its worst image
    # smallest over largest misfit of the turns about a continuous axis: near 0 for a polygon,
    # which fits at some angles only; 1 for other symmetries
    roundness: float = 1.0


@dataclass(frozen=True)
class Assessment:
    """The doubt of an object, 0 to 1, and its rejected candidates, the likeliest first."""

    doubt: float
    rejected: tuple[Symmetry, ...]


@dataclass(frozen=True)
class Gauge:
    """A mesh's surface in its canonical pose, with samples to measure symmetries on."""

    pose: CanonicalPose
    shape: UnitSurface
    config: AnnotateSymmetryConfig

    @classmethod
    def of(cls, mesh: Mesh, config: AnnotateSymmetryConfig, rng: np.random.Generator) -> "Gauge":
        """Sample `mesh` independently of the samples used in detection."""
        coarser = replace(
            config,
            num_samples=min(NUM_SURFACE, config.num_samples),
            num_verification_samples=min(NUM_SAMPLES, config.num_verification_samples),
        )
        pose = CanonicalPose.of(mesh)
        return cls(pose, UnitSurface.from_mesh(pose.mesh, coarser, rng), config)

    def measure(self, symmetry: Symmetry) -> Measure:
        """Measure the fit of `symmetry`, mesh frame, metres."""
        shape, posed = self.shape, self.pose.posed(symmetry)
        point = (posed.point - shape.center) / shape.size
        match posed:
            case ReflectionSymmetry():
                plane = np.append(posed.normal, point @ posed.normal)
                return self._measure(
                    [fit_of_plane(shape, plane, shape.samples)], self.config.max_mean
                )
            case RotationSymmetry(order=None):
                fits = self._turns(posed.axis, point, VERIFICATION_ANGLES)
                measure = self._measure(fits, self.config.max_axis_mean)
                misses = [fit.miss for fit in fits]
                oval = max(fit.ovalness for fit in fits)
                roundness = min(misses) / max(*misses, 1e-9)
                return Measure(max(measure.strain, oval), measure.error, roundness)
            case RotationSymmetry():
                fits = self._turns(posed.axis, point, [2.0 * np.pi / (posed.order or 1)])
                return self._measure(fits, self.config.max_mean)
            case SphereSymmetry():
                fits = [
                    fit for axis in np.eye(3) for fit in self._turns(axis, point, SPHERE_ANGLES)
                ]
                return self._measure(fits, self.config.max_axis_mean)

    def assess(self, accepted: Sequence[Symmetry], rejected: Sequence[Symmetry]) -> Assessment:
        """Return the doubt of the decision between `accepted` and `rejected` symmetries.

        Rejected candidates that follow from an accepted symmetry are left out.
        """
        doubts = [min(self.measure(symmetry).strain, 1.0) for symmetry in accepted]
        others = [c for c in rejected if not any(self._implies(known, c) for known in accepted)]
        others = sorted(others, key=lambda each: each.error)[:NUM_MEASURED]
        if not any(isinstance(symmetry, SphereSymmetry) for symmetry in accepted):
            center, _ = robust_sphere(self.shape.samples.points)
            others.append(self.pose.given(SphereSymmetry(self.shape.to_mesh(center))))
        measures = [self.measure(symmetry) for symmetry in others]
        # Nearness of each candidate to holding, 0 to 1.
        near = [min(1.0 / max(each.strain, 1.0), each.roundness) for each in measures]
        reported = [
            replace(others[index], error=measures[index].error)
            for index in np.argsort(near)[::-1].tolist()
            if near[index] > LIKELY or not isinstance(others[index], SphereSymmetry)
        ]
        doubt = round(max([*doubts, *near], default=0.0), 4)
        return Assessment(doubt, tuple(reported[:NUM_REPORTED]))

    def _turns(self, axis: Array, point: Array, angles: Sequence[float]) -> list[SurfaceFit]:
        line = np.concatenate([axis, point])
        return [fit_of_turn(self.shape, line, angle, self.shape.samples) for angle in angles]

    def _measure(self, fits: Sequence[SurfaceFit], max_mean: float) -> Measure:
        strain = max(_strain(fit, self.config, max_mean) for fit in fits)
        return Measure(strain, max(fit.error for fit in fits))

    def _implies(self, known: Symmetry, candidate: Symmetry) -> bool:
        """Return whether `candidate` is nearly `known`, or follows from `known`."""
        between = candidate.point - known.point
        reach = IMPLIED_OFFSET * self.shape.size * self.pose.size
        match known, candidate:
            case ReflectionSymmetry(), ReflectionSymmetry():
                return bool(abs(known.normal @ candidate.normal) > IMPLIED_COSINE)
            case RotationSymmetry(), RotationSymmetry():
                same = abs(known.axis @ candidate.axis) > IMPLIED_COSINE
                return bool(same and known.order == candidate.order)
            case RotationSymmetry(order=None), ReflectionSymmetry():
                through = abs(between @ candidate.normal) < reach
                across = abs(known.axis @ candidate.normal) < np.sqrt(1.0 - IMPLIED_COSINE**2)
                return bool(through and across)
            case SphereSymmetry(), _:
                return True
            case _:
                return False


def _strain(fit: SurfaceFit, config: AnnotateSymmetryConfig, max_mean: float) -> float:
    """Return the factor on all limits with which `fit` would just hold."""
    if not fit.holds(_widened(config, STRAINS[-1]), max_mean * STRAINS[-1]):
        return float(STRAINS[-1])
    place = bisect_left(
        STRAINS, True, key=lambda factor: fit.holds(_widened(config, factor), max_mean * factor)
    )
    return float(STRAINS[place])


@lru_cache(maxsize=2 * len(STRAINS))
def _widened(config: AnnotateSymmetryConfig, factor: float) -> AnnotateSymmetryConfig:
    return replace(
        config,
        max_mean=config.max_mean * factor,
        max_p95=config.max_p95 * factor,
        max_p99=config.max_p99 * factor,
        max_error=config.max_error * factor,
        max_unseen=config.max_unseen * factor,
        min_agreement=1.0 - (1.0 - config.min_agreement) * factor,
    )
