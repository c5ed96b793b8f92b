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

from collections.abc import Iterable, Sequence
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
from pipelines.grasping.rated_grasps import GraspSample, RatedGrasps
from pipelines.grasping.symmetrize import copies_under, symmetry_group
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction, on_grid

Array = NDArray[np.float64]

STAGE = "refine-grasps"
NUM_SURFACE_SAMPLES = 30000


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
    label = _existing(root.grasp_label_path(object_id), "symgrasp synthesize")
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
    sample, num_labelled = exact_grasps(mesh, label, config, seed)
    found, num_dropped = sample.result(), 0
    refined = found
    if config.use_symmetry:
        refined, num_dropped = with_copies(found, symmetries, surface, mesh, config, rng)
    before, after = (
        point_affordance(points, rated.grasps.contacts, rated.quality, config.contact_radius)
        for rated in (found, refined)
    )
    counts = RefinementCounts(
        num_labelled=num_labelled,
        num_distinct=sample.num_distinct,
        num_originals=len(found),
        num_copies=len(refined) - len(found),
        num_dropped=num_dropped,
        num_points_before=int(np.count_nonzero(before)),
        num_points_after=int(np.count_nonzero(after)),
    )
    grasps = refined.grasps
    return AffordanceLabels(
        grasps.contacts, grasps.approach, refined.quality, points, normals, after, counts
    )


def exact_grasps(
    mesh: Mesh, label: Iterable[GraspLabel], config: RefineGraspsConfig, seed: int
) -> tuple[GraspSample, int]:
    """Return the labelled grasps that hold, with contacts found anew, and how many were labelled.

    Of grasps with the same contacts only the best is kept.
    """
    sample, count = GraspSample(config.merge_distance, config.max_grasps, seed), 0
    for piece in label:
        holding = holding_grasps(piece, config.max_friction)
        count += len(holding)
        sample.add(_closed(mesh, holding))
    return sample, count


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


def with_copies(
    rated: RatedGrasps,
    symmetries: ObjectSymmetries,
    surface: Surface,
    mesh: Mesh,
    config: RefineGraspsConfig,
    rng: np.random.Generator,
) -> tuple[RatedGrasps, int]:
    """Return `rated` and after them their copies that hold, and the number of those that do not.

    The object's symmetries copy every grasp. A region's copy the grasps that touch the region with
    both fingers, copies by the object's symmetries among them.
    """
    rated, dropped = _copied(rated, symmetries.symmetries, surface, mesh, config, rng)
    for region in symmetries.regions:
        own = [s for s in region.symmetries if not _is_listed(s, symmetries.symmetries)]
        if not own:
            continue
        inside = np.isin(surface.faces, region.triangles)
        owner = np.asarray(inside[surface.nearest(rated.grasps.contacts)].all(axis=1))
        part = rated[owner]
        more, missed = _copied(part, own, surface, mesh, config, rng)
        copies = more[np.arange(len(part), len(more))]
        rated, dropped = RatedGrasps.concatenate([rated, copies]), dropped + missed
    return rated, dropped


def _copied(
    rated: RatedGrasps,
    symmetries: Sequence[Symmetry],
    surface: Surface,
    mesh: Mesh,
    config: RefineGraspsConfig,
    rng: np.random.Generator,
) -> tuple[RatedGrasps, int]:
    grasps, origin = copies_under(
        rated.grasps,
        symmetry_group(symmetries, config.copies_per_turn),
        merge_distance=config.merge_distance,
        max_copies=config.max_copies,
        rng=rng,
    )
    copies = RatedGrasps(grasps, rated.quality[origin])
    if config.validate_copies:
        held = _validated(copies, mesh, config)
    else:
        held = _on_surface(copies, surface, config)
    return RatedGrasps.concatenate([rated, held]), len(copies) - len(held)


def _on_surface(copies: RatedGrasps, surface: Surface, config: RefineGraspsConfig) -> RatedGrasps:
    """Return the copies whose contacts lie on the surface: scans are symmetric only so far."""
    gap = surface.distances(copies.grasps.contacts.reshape(-1, 3), num_nearest=1)[0]
    return copies[gap.reshape(-1, 2).max(axis=1, initial=0.0) <= config.max_surface_gap]


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
