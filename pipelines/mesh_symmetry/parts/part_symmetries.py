"""Symmetries of an object's parts: their own, and planes shared with the whole object."""

from dataclasses import dataclass, replace

import numpy as np

from pipelines.array_types import Mask
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.mesh_symmetry.detection.symmetry_detection import (
    MeshSymmetries,
    analyse,
    analyse_body,
    holding,
)
from pipelines.mesh_symmetry.detection.symmetry_verification import SUPPORT_COSINE, SUPPORT_DISTANCE
from pipelines.mesh_symmetry.parts.revolved_bodies import Body
from pipelines.mesh_symmetry.parts.sampled_parts import SampledParts

PIECE_SAMPLES = 12000  # at most, of the surface of a part
SAME_DIRECTION = float(np.cos(np.radians(10.0)))  # of two planes, or axes, of one object
NUM_PARTIAL = 6  # rejected candidates that are tried on parts


@dataclass(frozen=True)
class PartSymmetries:
    """Search for the symmetries of parts, given those detected on the whole object."""

    parts: SampledParts
    detection: MeshSymmetries
    config: AnnotateSymmetryConfig
    rng: np.random.Generator
    size: float  # diameter of the object, metres

    def body(self, body: Body) -> list[Symmetry]:
        """Return the symmetries of a body of revolution: at least its axis, or a sphere.

        The list is empty for a whole object without a continuous axis, as an almost round column,
        and for nearly the whole of an object whose axis was dropped.
        """
        axis = RotationSymmetry(body.axis.direction, body.axis.point)
        mesh = self.parts.submesh(body.members)
        is_cut = self.parts.touching(body.members, ~body.members) > 0.0
        found = analyse_body(mesh, axis, self._coarser, self.rng, is_cut=is_cut)
        kept = self._without_dropped(found, body.members)
        return kept if any(is_round(symmetry) for symmetry in kept) else []

    def part(self, members: Mask) -> list[Symmetry]:
        """Return the symmetries of the part `members` (m,), its own and shared planes.

        The whole object has the symmetries of the detection, or those that a person left.
        """
        # Of the whole object too, so that what is drawn for later parts does not depend on it.
        found = analyse(self.parts.submesh(members), self._coarser, self.rng).symmetries
        if members.all():
            return list(self.detection.symmetries)
        if any(is_round(symmetry) for symmetry in found):
            return self._without_dropped(found, members)
        planes = [symmetry for symmetry in found if isinstance(symmetry, ReflectionSymmetry)]
        others = [symmetry for symmetry in found if not isinstance(symmetry, ReflectionSymmetry)]
        planes = self._with_shared(planes, members)
        return self._without_dropped([*planes, *others], members)

    def still_held(self, symmetries: list[Symmetry], members: Mask) -> list[Symmetry] | None:
        """Return `symmetries` with the errors of their planes on the samples `members` (m,).

        None if a plane does not hold on these samples.
        """
        planes = [symmetry for symmetry in symmetries if isinstance(symmetry, ReflectionSymmetry)]
        others = [each for each in symmetries if not isinstance(each, ReflectionSymmetry)]
        held = self._held(planes, self.parts.submesh(members))
        return [*held, *others] if len(held) == len(planes) else None

    def largest_mirrored(self, members: Mask) -> Mask | None:
        """Return the largest connected part of `members` that a plane of the object explains.

        None if the part is less than `min_region_support` of `members`: the cut would be at an
        invisible border, where the plane stops holding.
        """
        for plane in self._planes():
            held = members.copy()
            held[members] = self._supported(plane, members)
            clusters = self.parts.clusters(self.parts.smoothed(held) & members)
            enough = self.config.min_region_support * members.sum()
            if clusters and clusters[0].sum() >= enough:
                return clusters[0]
        return None

    def _without_dropped(self, symmetries: list[Symmetry], members: Mask) -> list[Symmetry]:
        """Return `symmetries`, without dropped ones if hardly anything is left beside `members`."""
        if members.mean() <= 1.0 - self.config.min_part_share:
            return symmetries
        dropped = self.detection.dropped
        return [found for found in symmetries if not any(is_same(found, each) for each in dropped)]

    def _planes(self) -> list[ReflectionSymmetry]:
        known = [*self.detection.symmetries, *self.detection.partial[:NUM_PARTIAL]]
        return [symmetry for symmetry in known if isinstance(symmetry, ReflectionSymmetry)]

    def _with_shared(
        self, planes: list[ReflectionSymmetry], members: Mask
    ) -> list[ReflectionSymmetry]:
        """Return `planes`, and further planes of the object that hold on `members`, up to three."""
        room = self.config.max_planes - len(planes)
        others = [
            plane
            for plane in self._planes()
            if not _is_among(plane, planes)
            and self._supported(plane, members).mean() >= self.config.min_agreement
        ]
        if not others or room <= 0:
            return planes
        shared: list[ReflectionSymmetry] = []
        for plane in self._held(others, self.parts.submesh(members)):
            if len(shared) < room and not _is_among(plane, shared):
                shared.append(plane)
        return [*planes, *shared]

    def _held(self, planes: list[ReflectionSymmetry], mesh: Mesh) -> list[ReflectionSymmetry]:
        # A separate generator, so that samples of other parts do not depend on this call.
        return holding(planes, mesh, self._coarser, self.rng.spawn(1)[0])

    def _supported(self, plane: ReflectionSymmetry, members: Mask) -> Mask:
        """Return the mask (k,) of `members` whose image is on the surface of `members`."""
        surface = self.parts.surface
        image = plane.counterpart(surface.points[members])
        normals = plane.mirror_vectors(surface.normals[members])
        index = surface.nearest(image)
        met = surface.normals[index]
        gap = np.einsum("nd,nd->n", image - surface.points[index], met)
        beside = np.linalg.norm(image - surface.points[index], axis=1)
        tolerance = SUPPORT_DISTANCE * self.size
        near = (np.abs(gap) < tolerance) & (beside < 3.0 * tolerance) & members[index]
        return np.asarray(near & (np.abs(np.einsum("nd,nd->n", met, normals)) > SUPPORT_COSINE))

    @property
    def _coarser(self) -> AnnotateSymmetryConfig:
        """The configuration for parts, with fewer samples than for the object."""
        return replace(self.config, num_samples=min(PIECE_SAMPLES, self.config.num_samples))


def _is_among(plane: ReflectionSymmetry, others: list[ReflectionSymmetry]) -> bool:
    return any(abs(plane.normal @ other.normal) > SAME_DIRECTION for other in others)


def is_same(first: Symmetry, second: Symmetry) -> bool:
    """Return whether two symmetries of one object differ in accuracy only."""
    if first.kind != second.kind or getattr(first, "order", None) != getattr(second, "order", None):
        return False
    is_sphere = isinstance(first, SphereSymmetry)
    return is_sphere or bool(abs(first.direction @ second.direction) > SAME_DIRECTION)


def is_round(symmetry: Symmetry) -> bool:
    """Return whether `symmetry` is a continuous rotation or a sphere."""
    continuous = isinstance(symmetry, RotationSymmetry) and symmetry.order is None
    return continuous or isinstance(symmetry, SphereSymmetry)
