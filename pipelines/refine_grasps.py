"""refine-grasps: make grasp annotations symmetric, and spread them to affordance (Sec. III-G).

Reads   ROOT/models/NNN/nontextured.ply    the mesh that the contacts are found on
        ROOT/grasp_label/NNN_labels.npz    sampled-and-validated grasps, GraspNet's arrays
        ROOT/symmetry/NNN.json             from annotate-symmetry
Writes  ROOT/affordance/NNN.h5             contact pairs with their copies, affordance of the
                                           surface; canonical frame

The fingers of each labelled grasp are closed anew on the mesh by exact rays, so labels made on
another grid or another sampling of the surface give exact contacts. A label is read piece by
piece: its fifty million candidates are never in memory together.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.configs import RefineGraspsConfig
from pipelines.errors import MissingInputError
from pipelines.formats import affordance_labels, symmetry_labels
from pipelines.formats.affordance_labels import AffordanceLabels, RefinementCounts
from pipelines.formats.graspnet import GraspLabel, GraspNetRoot, LabelledGrasps, holding_grasps
from pipelines.formats.graspnet_label_stream import grasp_label_pieces
from pipelines.formats.graspnet_labels import GRID
from pipelines.formats.meshes import read_mesh
from pipelines.formats.provenance import digest, make_stamp
from pipelines.formats.symmetry_labels import ObjectSymmetries
from pipelines.geometry.mesh import Mesh, sample_surface
from pipelines.geometry.surface import Surface
from pipelines.geometry.symmetry import Symmetry
from pipelines.grasping.affordance import point_affordance
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.rated_grasps import BestOfPlaces, GraspSample, RatedGrasps
from pipelines.grasping.symmetrize import copies_under, image, symmetry_group
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction, on_grid

Array = NDArray[np.float64]

STAGE = "refine-grasps"
NUM_SURFACE_SAMPLES = 30000
SAMPLE_SPACINGS = 6.0  # no place of the surface is so far from its samples
PLACE_SHARE = 0.5  # of the contact radius: the best grasp at each such place stands for all there


def run(
    source: Path,
    config: RefineGraspsConfig,
    *,
    seed: int = 0,
    options: BatchOptions | None = None,
) -> StageReport:
    """Refine the grasp labels of every object of the dataset root `source`."""
    root = GraspNetRoot(source)
    items = [_item(root, object_id, config, seed) for object_id in root.object_ids()]
    step = partial(refine_file, root=root, config=config, seed=seed)
    return run_batch(STAGE, items, step, options or BatchOptions())


def refine_file(item: WorkItem, root: GraspNetRoot, config: RefineGraspsConfig, seed: int) -> str:
    """Refine the labels of one object; `item.arguments` is its id. Return the counts."""
    (object_id,) = item.arguments
    symmetry = _existing(root.symmetry_path(object_id), "symgrasp annotate-symmetry")
    label = _existing(root.grasp_label_path(object_id), "symgrasp label-grasps")
    pieces = grasp_label_pieces(label, max(1, config.chunk // int(np.prod(GRID))))
    mesh = read_mesh(root.model_path(object_id))
    labels = refine(mesh, pieces, symmetry_labels.read(symmetry), config, seed)
    affordance_labels.write(item.target, labels, item.stamp)
    return _note(labels)


def refine(
    mesh: Mesh,
    label: Iterable[GraspLabel],
    symmetries: ObjectSymmetries,
    config: RefineGraspsConfig,
    seed: int = 0,
) -> AffordanceLabels:
    """Return the refined labels of one object, object frame; `label` comes in pieces."""
    rng = np.random.default_rng(seed)
    points, normals, _ = sample_surface(mesh, config.num_surface_points, rng)
    surface = Surface.from_mesh(mesh, NUM_SURFACE_SAMPLES, rng)
    given = symmetries if config.use_symmetry else ObjectSymmetries(symmetries.name, ())
    copier = Copier(mesh, surface, given, config)
    found = exact_grasps(mesh, label, config, seed)
    refined, num_dropped = copier.with_copies(found.sample, rng)
    before, after = copier.affordance(points, found.best)
    counts = RefinementCounts(
        num_labelled=found.num_labelled,
        num_distinct=found.num_distinct,
        num_originals=len(found.sample),
        num_copies=len(refined) - len(found.sample),
        num_dropped=num_dropped,
        num_points_before=int(np.count_nonzero(before)),
        num_points_after=int(np.count_nonzero(after)),
    )
    grasps = refined.grasps
    return AffordanceLabels(
        grasps.contacts, grasps.approach, refined.quality, points, normals, after, counts
    )


@dataclass(frozen=True)
class ExactGrasps:
    """The grasps of a label that hold, between exact contacts."""

    sample: RatedGrasps  # at most `max_grasps` of those with different contacts
    best: RatedGrasps  # the best of all at each place that a finger touches
    num_labelled: int
    num_distinct: int


def exact_grasps(
    mesh: Mesh, label: Iterable[GraspLabel], config: RefineGraspsConfig, seed: int = 0
) -> ExactGrasps:
    """Return the labelled grasps that hold, with contacts found anew; `label` comes in pieces."""
    sample = GraspSample(config.merge_distance, config.max_grasps, seed)
    best, count = BestOfPlaces(config.contact_radius * PLACE_SHARE), 0
    for piece in label:
        holding = holding_grasps(piece, config.max_friction)
        count += len(holding)
        closed = _closed(mesh, holding)
        sample.add(closed)
        best.add(closed)
    return ExactGrasps(sample.result(), best.result(), count, sample.num_distinct)


def _closed(mesh: Mesh, holding: LabelledGrasps) -> RatedGrasps:
    """Return those of `holding` whose fingers both meet the mesh, between the exact contacts."""
    rotation = _orthonormal(holding.rotation.astype(np.float64))
    tips = holding.origin + holding.depth[:, None].astype(np.float64) * rotation[:, :, 0]
    opened = Grasps(rotation, tips, holding.opening.astype(np.float64))
    pairs, index = _contact_pairs(mesh, opened)[:2]
    quality = 1.0 - holding.min_friction[index].astype(np.float64).round(6)
    return RatedGrasps(Grasps.from_contacts(pairs, opened.approach[index]), quality)


def _contact_pairs(mesh: Mesh, opened: Grasps) -> tuple[Array, NDArray[np.int64], Array]:
    """Return the contacts (m, 2, 3) of those of `opened` that have both, their indices, friction.

    The width of `opened` is the opening that the fingers close from.
    """
    contacts = close_fingers(mesh, opened, opened.width)
    apart = np.linalg.norm(contacts.points[:, 1] - contacts.points[:, 0], axis=1) > 0.0
    index = np.flatnonzero(contacts.found & apart)
    return contacts.points[index], index, min_friction(contacts)[index]


def _orthonormal(rotation: Array) -> Array:
    """Return the float32 rotations (n, 3, 3) of the view template, orthonormal in float64."""
    approach, closing = rotation[:, :, 0], rotation[:, :, 1]
    approach = approach / np.linalg.norm(approach, axis=1, keepdims=True)
    closing = closing - np.einsum("ni,ni->n", closing, approach)[:, None] * approach
    closing = closing / np.linalg.norm(closing, axis=1, keepdims=True)
    return np.stack([approach, closing, np.cross(approach, closing)], axis=-1)


@dataclass(frozen=True)
class Copier:
    """Copies grasps across an object's symmetries, object frame.

    The object's symmetries copy every grasp. A region's copy the grasps that touch the region with
    both fingers, copies by the object's symmetries among them.
    """

    mesh: Mesh
    surface: Surface
    symmetries: ObjectSymmetries
    config: RefineGraspsConfig

    def with_copies(self, rated: RatedGrasps, rng: np.random.Generator) -> tuple[RatedGrasps, int]:
        """Return `rated`, after them copies that hold, and the number of those that do not."""
        rated, dropped = self._copied(rated, self.symmetries.symmetries, rng)
        for inside, own in self._regions():
            part = rated[self._touches(rated, inside)]
            more, missed = self._copied(part, own, rng)
            copies = more[np.arange(len(part), len(more))]
            rated, dropped = RatedGrasps.concatenate([rated, copies]), dropped + missed
        return rated, dropped

    def affordance(self, points: Array, rated: RatedGrasps) -> tuple[Array, Array]:
        """Return the affordance (n,) of `points` (n, 3) from `rated` alone, and with all copies."""
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
        """Return the affordance (n,): `known`, or better by a copy of `rated`."""
        after, radius = known.copy(), self.config.contact_radius
        for T in symmetry_group(symmetries, self.config.copies_per_turn):
            # Grasps no better than what every point has already need not be copied.
            wanting = np.flatnonzero(after < rated.quality.max(initial=0.0))
            rated = rated[rated.quality > after.min(initial=1.0)]
            if not len(wanting):
                break
            held = self._held(RatedGrasps(image(rated.grasps, T), rated.quality))
            found = point_affordance(points[wanting], held.grasps.contacts, held.quality, radius)
            after[wanting] = np.maximum(after[wanting], found)
        return after

    def _everywhere(self, rated: RatedGrasps) -> RatedGrasps:
        """Return the best at each place of `rated` and their copies by the whole's symmetries."""
        places = BestOfPlaces(self.config.contact_radius * PLACE_SHARE)
        places.add(rated)
        for T in symmetry_group(self.symmetries.symmetries, self.config.copies_per_turn):
            places.add(self._held(RatedGrasps(image(rated.grasps, T), rated.quality)))
        return places.result()

    def _regions(self) -> Iterator[tuple[NDArray[np.bool_], list[Symmetry]]]:
        """Yield which surface samples lie on a region, and symmetries that it has of its own."""
        listed = self.symmetries.symmetries
        for region in self.symmetries.regions:
            own = [each for each in region.symmetries if not _is_listed(each, listed)]
            if own:
                yield np.isin(self.surface.faces, region.triangles), own

    def _touches(self, rated: RatedGrasps, inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which grasps have both contacts on what the surface samples `inside` lie on."""
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
        """Return the copies that hold on the mesh, or just lie on it: scans are not exact."""
        if self.config.validate_copies:
            return _validated(copies, self.mesh, self.config)
        limit = self.config.max_surface_gap
        reach = 2.0 * limit + SAMPLE_SPACINGS * self.surface.spacing
        contacts = copies.grasps.contacts.reshape(-1, 3)
        gap = self.surface.distances(contacts, num_nearest=1, reach=reach)[0]
        farthest = gap.reshape(-1, 2).max(axis=1, initial=0.0)
        return copies[farthest <= limit]


def _validated(copies: RatedGrasps, mesh: Mesh, config: RefineGraspsConfig) -> RatedGrasps:
    """Return the copies that hold on the mesh, between exact contacts, with their own friction.

    The fingers close from `max_surface_gap` beyond each contact and must meet the surface within
    as much of it. Friction is measured on the labels' grid.
    """
    gap, grasps = config.max_surface_gap, copies.grasps
    opened = Grasps(grasps.rotation, grasps.translation, grasps.width + 2.0 * gap)
    pairs, index, friction = _contact_pairs(mesh, opened)
    friction = on_grid(friction)
    moved = np.linalg.norm(pairs - grasps.contacts[index], axis=2).max(axis=1, initial=0.0)
    kept = (moved <= gap) & (friction <= config.max_friction)
    approach = grasps.approach[index[kept]]
    return RatedGrasps(Grasps.from_contacts(pairs[kept], approach), 1.0 - friction[kept])


def _is_listed(symmetry: Symmetry, listed: Sequence[Symmetry]) -> bool:
    """Return whether `symmetry` is one of `listed`, as the whole's region repeats the object's."""
    return any(
        symmetry.kind == other.kind
        and np.allclose(symmetry.point, other.point)
        and np.allclose(symmetry.direction, other.direction, equal_nan=True)
        for other in listed
    )


def _note(labels: AffordanceLabels) -> str:
    counts, points = labels.counts, len(labels.points)
    dropped = f" ({counts.num_dropped} dropped)" if counts.num_dropped else ""
    return (
        f"{counts.num_labelled} labelled grasps, {counts.num_distinct} distinct contact pairs, "
        f"{counts.num_originals} kept, {counts.num_originals + counts.num_copies} with copies"
        f"{dropped}; affordance on {counts.num_points_before} of {points} surface points before, "
        f"{counts.num_points_after} after"
    )


def _existing(path: Path, written_by: str) -> Path:
    if not path.is_file():
        raise MissingInputError(path, written_by)
    return path


def _item(root: GraspNetRoot, object_id: int, config: RefineGraspsConfig, seed: int) -> WorkItem:
    paths = {
        "mesh": root.model_path(object_id),
        "grasp_label": root.grasp_label_path(object_id),
        "symmetry": root.symmetry_path(object_id),
    }
    # An input that is not there fails as its own item, when it is read.
    inputs = {key: digest(path) if path.is_file() else "missing" for key, path in paths.items()}
    stamp = make_stamp(STAGE, config, seed=seed, inputs=inputs)
    return WorkItem(f"{object_id:03d}", root.affordance_path(object_id), stamp, (object_id,))
