"""Stage `refine-grasps`: symmetric copies of grasp labels, and affordance (Sec. III-G).

Reads   ROOT/models/NNN/nontextured.ply    the mesh on which contacts are found
        ROOT/grasp_label/NNN_labels.npz    sampled and validated grasps, GraspNet's arrays
        ROOT/symmetry/NNN.json             from annotate-symmetry
Writes  ROOT/affordance/NNN.h5             contact pairs with their copies, affordance of the
                                           surface; canonical frame

The fingers of each labelled grasp close on the mesh along exact rays, so labels on any grid or
sampling of the surface give exact contacts. A label is read in pieces, since it has up to fifty
million candidates.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import RefineGraspsConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_label_stream import grasp_label_pieces
from pipelines.dataset.graspnet.graspnet_labels import (
    LABEL_GRID,
    GraspLabel,
    LabelledGrasps,
    holding_grasps,
)
from pipelines.dataset.meshes import read_solid_mesh
from pipelines.dataset.stale_labels import refuse_labels_of_another
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.dataset.training import affordance_labels
from pipelines.dataset.training.affordance_labels import AffordanceLabels, RefinementCounts
from pipelines.errors import SymgraspError
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.rated_grasps import GraspSample, RatedGrasps, best_of_places
from pipelines.mesh_symmetry.surface.sampled_surface import Surface
from pipelines.refinement.copies import PLACE_SHARE, Copier, closed_contacts
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import existing
from pipelines.storage.provenance import digest_if_there, make_stamp

STAGE = "refine-grasps"
NUM_SURFACE_SAMPLES = 30000


@one_run_at_a_time(STAGE, "source")
def run(
    source: Path, config: RefineGraspsConfig, *, seed: int = 0, options: BatchOptions | None = None
) -> StageReport:
    """Refine the grasp labels of every object of the dataset root `source`."""
    root = GraspNetRoot.finished(source)
    items = [_item(root, object_id, config, seed) for object_id in root.checked_object_ids()]
    step = partial(refine_file, root=root, config=config, seed=seed)
    report = run_batch(STAGE, items, step, options or BatchOptions())
    report.has_next = (source / "scenes").is_dir() and bool(root.scenes(split="train"))
    return report


def refine_file(item: WorkItem, root: GraspNetRoot, config: RefineGraspsConfig, seed: int) -> str:
    """Refine the labels of one object; `item.arguments`: its id. Return the counts."""
    (object_id,) = item.arguments
    symmetry = existing(root.symmetry_path(object_id), "symgrasp annotate-symmetry")
    label = existing(root.grasp_label_path(object_id), "symgrasp label-grasps")
    model = root.model_path(object_id)
    refuse_labels_of_another("mesh", model, symmetry, "annotate it again")
    refuse_labels_of_another(model.name, model, label, "label it again")
    pieces = grasp_label_pieces(label, max(1, config.chunk // int(np.prod(LABEL_GRID))))
    mesh = read_solid_mesh(model)
    labels = refine(mesh, pieces, symmetry_labels.read(symmetry), config, seed)
    if labels.counts.num_labelled and not labels.counts.num_distinct:
        raise SymgraspError(
            f"{label}: none of {labels.counts.num_labelled:,} labelled grasps meets the mesh "
            f"{model}; give the mesh that was labelled, in metres"
        )
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
    """The grasps of a label that hold, with exact contacts."""

    sample: RatedGrasps  # at most `max_grasps` grasps with distinct contacts
    best: RatedGrasps  # the best grasp at each place of a contact
    num_labelled: int
    num_distinct: int


def exact_grasps(
    mesh: Mesh, label: Iterable[GraspLabel], config: RefineGraspsConfig, seed: int = 0
) -> ExactGrasps:
    """Return the labelled grasps that hold, with exact contacts; `label` comes in pieces."""
    sample = GraspSample(config.merge_distance, config.max_grasps, seed)
    best, count = RatedGrasps.empty(), 0
    for piece in label:
        holding = holding_grasps(piece, config.max_friction)
        count += len(holding)
        closed = _closed(mesh, holding)
        sample.add(closed)
        best = best_of_places([best, closed], config.contact_radius * PLACE_SHARE)
    return ExactGrasps(sample.result(), best, count, sample.num_distinct)


def _closed(mesh: Mesh, holding: LabelledGrasps) -> RatedGrasps:
    """Return the grasps of `holding` where both fingers meet the mesh, with exact contacts."""
    rotation = _orthonormal(holding.rotation.astype(np.float64))
    tips = holding.origin + holding.depth[:, None].astype(np.float64) * rotation[:, :, 0]
    opened = GraspPoses(rotation, tips, holding.opening.astype(np.float64))
    pairs, index = closed_contacts(mesh, opened)[:2]
    quality = 1.0 - holding.min_friction[index].astype(np.float64).round(6)
    return RatedGrasps(GraspPoses.from_contacts(pairs, opened.approach[index]), quality)


def _orthonormal(rotation: Array) -> Array:
    """Return float32 rotations (n, 3, 3) of the view template, orthonormal in float64."""
    approach, closing = rotation[:, :, 0], rotation[:, :, 1]
    approach = approach / np.linalg.norm(approach, axis=1, keepdims=True)
    closing = closing - np.einsum("ni,ni->n", closing, approach)[:, None] * approach
    closing = closing / np.linalg.norm(closing, axis=1, keepdims=True)
    return np.stack([approach, closing, np.cross(approach, closing)], axis=-1)


def _note(labels: AffordanceLabels) -> str:
    counts, points = labels.counts, len(labels.points)
    dropped = f" ({counts.num_dropped} dropped)" if counts.num_dropped else ""
    return (
        f"{counts.num_labelled} labelled grasps, {counts.num_distinct} distinct contact pairs, "
        f"{counts.num_originals} kept, {counts.num_originals + counts.num_copies} with copies"
        f"{dropped}; affordance on {counts.num_points_before} of {points} surface points before, "
        f"{counts.num_points_after} after"
    )


def _item(root: GraspNetRoot, object_id: int, config: RefineGraspsConfig, seed: int) -> WorkItem:
    paths = {
        "mesh": root.model_path(object_id),
        "grasp_label": root.grasp_label_path(object_id),
        "symmetry": root.symmetry_path(object_id),
    }
    # A missing input fails its own item, when it is read.
    inputs = {key: digest_if_there(path) for key, path in paths.items()}
    stamp = make_stamp(STAGE, config, seed=seed, inputs=inputs)
    return WorkItem(f"{object_id:03d}", root.affordance_path(object_id), stamp, (object_id,))
