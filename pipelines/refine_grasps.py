"""refine-grasps: make grasp annotations symmetric, and spread them to affordance (Sec. III-G).

Reads   ROOT/models/NNN/nontextured.ply    the mesh that the contacts are found on
        ROOT/grasp_label/NNN_labels.npz    sampled-and-validated grasps, GraspNet's arrays
        ROOT/symmetry/NNN.json             from annotate-symmetry
Writes  ROOT/affordance/NNN.h5             contact pairs with their copies, affordance of the
                                           surface; canonical frame

The fingers of each labelled grasp are closed anew on the mesh by exact rays, so labels made on
another grid or another sampling of the surface give exact contacts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.configs import RefineGraspsConfig
from pipelines.errors import MissingInputError
from pipelines.formats import affordance_labels, symmetry_labels
from pipelines.formats.affordance_labels import AffordanceLabels
from pipelines.formats.graspnet import (
    GraspLabel,
    GraspNetRoot,
    LabelledGrasps,
    holding_grasps,
    read_grasp_label,
)
from pipelines.formats.meshes import read_mesh
from pipelines.formats.provenance import digest, make_stamp
from pipelines.formats.symmetry_labels import ObjectSymmetries
from pipelines.geometry.mesh import Mesh, sample_surface
from pipelines.geometry.surface import Surface
from pipelines.geometry.symmetry import Symmetry
from pipelines.grasping.affordance import point_affordance
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.symmetrize import distinct, num_images, symmetrize
from pipelines.metrics.contacts import close_fingers

Array = NDArray[np.float64]

STAGE = "refine-grasps"
NUM_SURFACE_SAMPLES = 30000


@dataclass(frozen=True)
class RatedGrasps:
    """Grasps with exact contacts, and `quality` (n,) = 1 - smallest friction coefficient."""

    grasps: Grasps
    quality: Array

    def __len__(self) -> int:
        return len(self.quality)

    def __getitem__(self, index: NDArray[np.integer] | NDArray[np.bool_]) -> "RatedGrasps":
        return RatedGrasps(self.grasps[index], self.quality[index])

    @classmethod
    def concatenate(cls, parts: Sequence["RatedGrasps"]) -> "RatedGrasps":
        """Return all grasps of `parts`, in order."""
        quality = [np.zeros(0), *(part.quality for part in parts)]
        return cls(Grasps.concatenate([part.grasps for part in parts]), np.concatenate(quality))


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
    labels, note = refine(
        read_mesh(root.model_path(object_id)),
        read_grasp_label(_existing(root.grasp_label_path(object_id), "symgrasp synthesize")),
        symmetry_labels.read(
            _existing(root.symmetry_path(object_id), "symgrasp annotate-symmetry")
        ),
        config,
        np.random.default_rng(seed),
    )
    affordance_labels.write(item.target, labels, item.stamp)
    return note


def refine(
    mesh: Mesh,
    label: GraspLabel,
    symmetries: ObjectSymmetries,
    config: RefineGraspsConfig,
    rng: np.random.Generator,
) -> tuple[AffordanceLabels, str]:
    """Return the refined labels of one object, object frame, and a sentence of counts."""
    points, normals, _ = sample_surface(mesh, config.num_surface_points, rng)
    found, num_labelled = exact_grasps(mesh, label, config)
    surface = Surface.from_mesh(mesh, NUM_SURFACE_SAMPLES, rng)
    refined = copied(found, symmetries, surface, config, rng) if config.use_symmetry else found
    before, after = (
        point_affordance(points, rated.grasps.contacts, rated.quality, config.contact_radius)
        for rated in (found, refined)
    )
    note = (
        f"{num_labelled} labelled grasps, {len(found)} distinct contact pairs, "
        f"{len(refined)} with copies; affordance on {np.count_nonzero(before)} of {len(points)} "
        f"surface points before, {np.count_nonzero(after)} after"
    )
    return (
        AffordanceLabels(
            refined.grasps.contacts,
            refined.grasps.approach,
            refined.quality,
            points,
            normals,
            after,
        ),
        note,
    )


def exact_grasps(
    mesh: Mesh, label: GraspLabel, config: RefineGraspsConfig
) -> tuple[RatedGrasps, int]:
    """Return the labelled grasps that hold, with contacts found anew, and how many were labelled.

    Works through the label by grasp points, so that fifty million candidates fit into memory.
    Best quality first; of grasps with the same contacts only the best is kept.
    """
    per_point = max(1, int(np.prod(label.min_friction.shape[1:])))
    stride = max(1, config.chunk // per_point)
    best, pending, count = RatedGrasps(Grasps.empty(), np.zeros(0)), list[RatedGrasps](), 0
    for start in range(0, len(label.points), stride):
        rows = slice(start, start + stride)
        part = GraspLabel(
            label.points[rows],
            label.offsets[rows],
            label.collision[rows],
            label.min_friction[rows],
        )
        holding = holding_grasps(part, config.max_friction)
        count += len(holding)
        pending.append(_best(_closed(mesh, holding), config.merge_distance))
        # Merged when there is as much new as old: each grasp is sorted a few times, not hundreds.
        if sum(map(len, pending)) > len(best):
            best = _best(RatedGrasps.concatenate([best, *pending]), config.merge_distance)
            pending.clear()
    return _best(RatedGrasps.concatenate([best, *pending]), config.merge_distance), count


def _closed(mesh: Mesh, holding: LabelledGrasps) -> RatedGrasps:
    """Return those of `holding` whose fingers both meet the mesh, between the exact contacts."""
    rotation = _orthonormal(holding.rotation.astype(np.float64))
    tips = holding.origin + holding.depth[:, None].astype(np.float64) * rotation[:, :, 0]
    opened = Grasps(rotation, tips, holding.opening.astype(np.float64))
    contacts = close_fingers(mesh, opened, opened.width)
    width = np.linalg.norm(contacts.points[:, 1] - contacts.points[:, 0], axis=1)
    found = contacts.found & (width > 0.0)
    pairs = contacts.points[found]
    grasps = replace(opened[found], translation=pairs.mean(axis=1), width=width[found])
    return RatedGrasps(grasps, 1.0 - holding.min_friction[found].astype(np.float64).round(6))


def _orthonormal(rotation: Array) -> Array:
    """Return the float32 rotations (n, 3, 3) of the view template, orthonormal in float64."""
    approach, closing = rotation[:, :, 0], rotation[:, :, 1]
    approach = approach / np.linalg.norm(approach, axis=1, keepdims=True)
    closing = closing - np.einsum("ni,ni->n", closing, approach)[:, None] * approach
    closing = closing / np.linalg.norm(closing, axis=1, keepdims=True)
    return np.stack([approach, closing, np.cross(approach, closing)], axis=-1)


def _best(rated: RatedGrasps, merge_distance: float) -> RatedGrasps:
    """Return one grasp of each group with the same contacts, best quality first."""
    ranked = rated[np.argsort(-rated.quality, kind="stable")]
    return ranked[distinct(ranked.grasps, merge_distance)]


def copied(
    rated: RatedGrasps,
    symmetries: ObjectSymmetries,
    surface: Surface,
    config: RefineGraspsConfig,
    rng: np.random.Generator,
) -> RatedGrasps:
    """Return `rated` with its copies: under the object's symmetries, and within its regions.

    A region's symmetry copies the grasps that touch the region with both fingers. Copies whose
    contacts miss the surface are dropped: scans are symmetric only so far.
    """
    for symmetry in symmetries.symmetries:
        rated = _with_copies(rated, symmetry, surface, config, rng)
    for region in symmetries.regions:
        own = [s for s in region.symmetries if not _is_listed(s, symmetries.symmetries)]
        if not own:
            continue
        inside = np.isin(surface.faces, region.triangles)
        owner = np.asarray(inside[surface.nearest(rated.grasps.contacts)].all(axis=1))
        part, rest = rated[owner], rated[~owner]
        for symmetry in own:
            part = _with_copies(part, symmetry, surface, config, rng)
        rated = RatedGrasps.concatenate([part, rest])
    return rated


def _with_copies(
    rated: RatedGrasps,
    symmetry: Symmetry,
    surface: Surface,
    config: RefineGraspsConfig,
    rng: np.random.Generator,
) -> RatedGrasps:
    limit = config.max_copies // num_images(symmetry, config.copies_per_turn)
    # A revolved label of a whole dataset would be millions of grasps that add nothing.
    source = rated if len(rated) <= limit else rated[np.sort(rng.permutation(len(rated))[:limit])]
    grasps, origin = symmetrize(
        source.grasps,
        symmetry,
        copies_per_turn=config.copies_per_turn,
        merge_distance=config.merge_distance,
    )
    copies = RatedGrasps(grasps, source.quality[origin])[np.arange(len(source), len(grasps))]
    gap = surface.distances(copies.grasps.contacts.reshape(-1, 3), num_nearest=1)[0]
    kept = gap.reshape(-1, 2).max(axis=1, initial=0.0) <= config.max_surface_gap
    return RatedGrasps.concatenate([rated, copies[kept]])


def _is_listed(symmetry: Symmetry, listed: Sequence[Symmetry]) -> bool:
    """Return whether `symmetry` is one of `listed`, as the whole's region repeats the object's."""
    return any(
        symmetry.kind == other.kind
        and np.allclose(symmetry.point, other.point)
        and np.allclose(symmetry.direction, other.direction, equal_nan=True)
        for other in listed
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
