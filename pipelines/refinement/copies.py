"""Symmetric copies of grasps, by the symmetries of an object and then of its regions (D. 2).

Also the affordance of the object's surface, from the copies.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import RefineGraspsConfig
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import Symmetry
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.rated_grasps import RatedGrasps, best_of_places
from pipelines.grasping.symmetrize import copies_under, image, symmetry_group
from pipelines.mesh_symmetry.surface.sampled_surface import Surface
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction, on_grid

SAMPLE_SPACINGS = 6.0  # more than the distance of any surface point from its nearest sample
PLACE_SHARE = 0.5  # of the contact radius; only the best grasp of a cell of this size is copied
NUM_LEVELS = 64  # more distinct qualities are rounded down to this number


@dataclass(frozen=True)
class Copier:
    """Copy grasps across an object's symmetries, object frame.

    The object's symmetries copy every grasp. A region's symmetries copy the grasps with both
    contacts on the region, including copies by the object's symmetries.
    """

    mesh: Mesh
    surface: Surface
    symmetries: ObjectSymmetries
    config: RefineGraspsConfig

    def with_copies(self, rated: RatedGrasps, rng: np.random.Generator) -> tuple[RatedGrasps, int]:
        """Return `rated` followed by its valid copies, and the number of invalid copies."""
        rated, dropped = self._copied(rated, self.symmetries.symmetries, rng)
        for inside, own in self._regions():
            part = rated[self._touches(rated, inside)]
            more, missed = self._copied(part, own, rng)
            copies = more[np.arange(len(part), len(more))]
            rated, dropped = RatedGrasps.concatenate([rated, copies]), dropped + missed
        return rated, dropped

    def affordance(self, points: Array, rated: RatedGrasps) -> tuple[Array, Array]:
        """Return affordances (n,) of `points` (n, 3) from `rated` alone, and with all copies."""
        before = point_affordance(
            points, rated.grasps.contacts, rated.quality, self.config.contact_radius
        )
        after = self._spread(points, before, rated, self.symmetries.symmetries)
        regions = list(self._regions())
        best = self._everywhere(rated) if regions else rated
        for inside, own in regions:
            after = self._spread(points, after, best[self._touches(best, inside)], own)
        return before, after

    def _spread(
        self, points: Array, known: Array, rated: RatedGrasps, symmetries: Sequence[Symmetry]
    ) -> Array:
        """Return the affordance (n,): the larger of `known` and the affordance of copies."""
        after, radius = known.copy(), self.config.contact_radius
        for T in symmetry_group(symmetries, self.config.copies_per_turn):
            # A grasp no better than the affordance of every point need not be copied.
            wanting = np.flatnonzero(after < rated.quality.max(initial=0.0))
            rated = rated[rated.quality > after.min(initial=1.0)]
            if not len(wanting):
                break
            held = self._held(RatedGrasps(image(rated.grasps, T), rated.quality))
            found = point_affordance(points[wanting], held.grasps.contacts, held.quality, radius)
            after[wanting] = np.maximum(after[wanting], found)
        return after

    def _everywhere(self, rated: RatedGrasps) -> RatedGrasps:
        """Return the best grasp of each place among `rated` and its copies by the object."""
        size = self.config.contact_radius * PLACE_SHARE
        best = best_of_places([rated], size)
        for T in symmetry_group(self.symmetries.symmetries, self.config.copies_per_turn):
            held = self._held(RatedGrasps(image(rated.grasps, T), rated.quality))
            best = best_of_places([best, held], size)
        return best

    def _regions(self) -> Iterator[tuple[Mask, list[Symmetry]]]:
        """Yield the mask of surface samples on each region, and its own symmetries."""
        listed = self.symmetries.symmetries
        for region in self.symmetries.regions:
            own = [each for each in region.symmetries if not _is_listed(each, listed)]
            if own:
                yield np.isin(self.surface.faces, region.triangles), own

    def _touches(self, rated: RatedGrasps, inside: Mask) -> Mask:
        """Return the mask of grasps with both contacts near the surface samples `inside`."""
        return np.asarray(inside[self.surface.nearest(rated.grasps.contacts)].all(axis=1))

    def _copied(
        self, rated: RatedGrasps, symmetries: Sequence[Symmetry], rng: np.random.Generator
    ) -> tuple[RatedGrasps, int]:
        grasps, origin = copies_under(
            rated.grasps,
            symmetry_group(symmetries, self.config.copies_per_turn),
            merge_distance=self.config.merge_distance,
            max_copies=self.config.max_copies,
            rng=rng,
        )
        held = self._held(RatedGrasps(grasps, rated.quality[origin]))
        return RatedGrasps.concatenate([rated, held]), len(grasps) - len(held)

    def _held(self, copies: RatedGrasps) -> RatedGrasps:
        """Return the copies that are valid on the mesh, or near it, since scans are not exact."""
        if self.config.validate_copies:
            return _validated(copies, self.mesh, self.config)
        limit = self.config.max_surface_gap
        reach = 2.0 * limit + SAMPLE_SPACINGS * self.surface.spacing
        contacts = copies.grasps.contacts.reshape(-1, 3)
        gap = self.surface.distances(contacts, num_nearest=1, reach=reach)[0]
        farthest = gap.reshape(-1, 2).max(axis=1, initial=0.0)
        return copies[farthest <= limit]


def _validated(copies: RatedGrasps, mesh: Mesh, config: RefineGraspsConfig) -> RatedGrasps:
    """Return the copies that are valid on the mesh, with exact contacts and measured friction.

    The fingers close from `max_surface_gap` outside of each contact and must meet the surface
    within the same distance of the contact. Friction is rounded up to the grid of the labels.
    """
    gap, grasps = config.max_surface_gap, copies.grasps
    opened = GraspPoses(grasps.rotation, grasps.translation, grasps.width + 2.0 * gap)
    pairs, index, friction = closed_contacts(mesh, opened)
    friction = on_grid(friction)
    moved = np.linalg.norm(pairs - grasps.contacts[index], axis=2).max(axis=1, initial=0.0)
    kept = (moved <= gap) & (friction <= config.max_friction)
    approach = grasps.approach[index[kept]]
    return RatedGrasps(GraspPoses.from_contacts(pairs[kept], approach), 1.0 - friction[kept])


def _is_listed(symmetry: Symmetry, listed: Sequence[Symmetry]) -> bool:
    """Return whether `symmetry` is in `listed`: a region of the whole repeats the object's."""
    return any(
        symmetry.kind == other.kind
        and getattr(symmetry, "order", None) == getattr(other, "order", None)
        and np.allclose(symmetry.point, other.point)
        and np.allclose(symmetry.direction, other.direction, equal_nan=True)
        for other in listed
    )


def closed_contacts(mesh: Mesh, opened: GraspPoses) -> tuple[Array, Indices, Array]:
    """Return contacts (m, 2, 3), indices (m,) and friction (m,) of grasps with two contacts.

    The width of `opened` is the opening from which the fingers close.
    """
    contacts = close_fingers(mesh, opened, opened.width)
    apart = np.linalg.norm(contacts.points[:, 1] - contacts.points[:, 0], axis=1) > 0.0
    index = np.flatnonzero(contacts.found & apart)
    return contacts.points[index], index, min_friction(contacts)[index]


def point_affordance(
    points: ArrayLike, contacts: ArrayLike, quality: ArrayLike, radius: float
) -> Array:
    """Return the best quality (n,) of the pairs with a contact within `radius` of each point.

    This is the quality of holding the object with one finger there (D. 9); 0 without a contact.

    Args:
        points: (n, 3) metres.
        contacts: (m, 2, 3) metres, contact pairs, same frame.
        quality: (m,) 1 - smallest friction coefficient, 0 to 1.
        radius: metres.
    """
    where = np.asarray(points, np.float64).reshape(-1, 3)
    pairs = np.asarray(contacts, np.float64).reshape(-1, 2, 3)
    levels = np.asarray(quality, np.float64)
    if len(np.unique(levels)) > NUM_LEVELS:
        levels = np.floor(levels * NUM_LEVELS) / NUM_LEVELS
    affordance = np.zeros(len(where))
    open_points = np.arange(len(where))
    # From the best quality down, each point takes the first level that reaches it.
    for level in np.unique(levels)[::-1]:
        if level <= 0.0 or not len(open_points):
            break
        tree = KDTree(pairs[levels == level].reshape(-1, 3))
        reach = tree.query(where[open_points], distance_upper_bound=radius)[0]
        reached = np.isfinite(reach)
        affordance[open_points[reached]] = level
        open_points = open_points[~reached]
    return affordance
