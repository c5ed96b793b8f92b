"""annotate-symmetry: find the symmetries and symmetric regions of meshes (Sec. III-D, III-G).

Reads   ROOT/models/NNN/nontextured.ply   a dataset, or any mesh or folder of meshes
        ROOT/regions/NNN.json             regions given by hand, where there are any: they win
Writes  ROOT/symmetry/NNN.json            symmetries and regions, canonical frame
        or OUT/NAME.json                  for loose meshes
"""

from functools import partial
from pathlib import Path

import numpy as np

from pipelines.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.errors import SymgraspError
from pipelines.formats import regions as manual_regions
from pipelines.formats import symmetry_labels
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.formats.meshes import MESH_SUFFIXES, find_meshes, read_mesh
from pipelines.formats.provenance import digest, make_stamp
from pipelines.formats.symmetry_labels import ObjectSymmetries, RegionLabel
from pipelines.geometry.mesh import Mesh
from pipelines.geometry.symmetric_parts import (
    SymmetricRegion,
    has_slot,
    symmetric_regions,
)
from pipelines.geometry.symmetry_detection import analyse, detect_symmetries

STAGE = "annotate-symmetry"


def run(
    source: Path,
    output_dir: Path | None,
    config: AnnotateSymmetryConfig,
    *,
    seed: int = 0,
    options: BatchOptions | None = None,
) -> StageReport:
    """Annotate a dataset root in place, or a mesh or a folder of meshes into `output_dir`."""
    items = _dataset_items(source, config, seed)
    if output_dir is not None or not items:
        items = _mesh_items(source, output_dir, config, seed)
    step = partial(annotate_file, config=config, seed=seed)
    return run_batch(STAGE, items, step, options or BatchOptions())


def annotate_file(item: WorkItem, config: AnnotateSymmetryConfig, seed: int) -> str:
    """Annotate one mesh file; `item.arguments` are the mesh and the hand-written regions."""
    mesh_path, regions_path = item.arguments
    mesh = read_mesh(mesh_path)
    labels = annotate(mesh, item.name, config, np.random.default_rng(seed), regions_path)
    symmetry_labels.write(item.target, labels, item.stamp)
    return _summary(labels)


def annotate(
    mesh: Mesh,
    name: str,
    config: AnnotateSymmetryConfig,
    rng: np.random.Generator,
    regions_path: Path | None = None,
) -> ObjectSymmetries:
    """Return the symmetries of `mesh` and its regions, those of `regions_path` if given."""
    detection = analyse(mesh, config, rng)
    regions = (
        symmetric_regions(mesh, detection, config, rng)
        if regions_path is None
        else _given_regions(mesh, regions_path, config, rng)
    )
    return ObjectSymmetries(
        name,
        tuple(detection.symmetries),
        tuple(RegionLabel(r.name, r.triangles, tuple(r.symmetries)) for r in regions),
    )


def _given_regions(
    mesh: Mesh, path: Path, config: AnnotateSymmetryConfig, rng: np.random.Generator
) -> list[SymmetricRegion]:
    regions = []
    for given in manual_regions.read(path, mesh):
        stated = given.symmetries
        found = (
            detect_symmetries(mesh.submesh(given.triangles), config, rng)
            if stated is None
            else list(stated)
        )
        regions.append(SymmetricRegion(given.name, given.triangles, found))
    return regions


def _dataset_items(source: Path, config: AnnotateSymmetryConfig, seed: int) -> list[WorkItem]:
    if not (source / "models").is_dir():
        return []
    root = GraspNetRoot(source)
    items = []
    for object_id in root.object_ids():
        mesh, regions = root.model_path(object_id), root.region_path(object_id)
        target = root.symmetry_path(object_id)
        items.append(_item(f"{object_id:03d}", mesh, regions, target, config, seed))
    return items


def _mesh_items(
    source: Path, output_dir: Path | None, config: AnnotateSymmetryConfig, seed: int
) -> list[WorkItem]:
    if not source.exists():
        raise SymgraspError(f"{source} does not exist; give a dataset root, a mesh or a folder")
    if output_dir is None:
        raise SymgraspError(
            f"{source} holds no models/ folder, so it is no dataset; pass --out for loose meshes"
        )
    meshes = find_meshes(source) if source.is_dir() else [source]
    if not meshes:
        kinds = ", ".join(MESH_SUFFIXES)
        raise SymgraspError(f"{source} holds no meshes; files ending in {kinds} are read")
    return [
        _item(path.stem, path, None, output_dir / f"{path.stem}.json", config, seed)
        for path in meshes
    ]


def _item(
    name: str,
    mesh: Path,
    regions: Path | None,
    target: Path,
    config: AnnotateSymmetryConfig,
    seed: int,
) -> WorkItem:
    given = regions if regions is not None and regions.is_file() else None
    # A mesh that is not there fails as its own item, when it is read.
    inputs = {"mesh": digest(mesh) if mesh.is_file() else "missing"}
    inputs |= {} if given is None else {"regions": digest(given)}
    stamp = make_stamp(STAGE, config, seed=seed, inputs=inputs)
    return WorkItem(name, target, stamp, (mesh, given))


def _summary(labels: ObjectSymmetries) -> str:
    kinds = [symmetry.kind for symmetry in labels.symmetries]
    counts = [f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)]
    text = ", ".join(counts) or "no symmetry"
    if has_slot(list(labels.symmetries)) and len(labels.regions) == 1:
        return text
    return f"{text}; regions: {', '.join(region.name for region in labels.regions)}"
