"""Work items of `annotate-symmetry`: one per object, with the inputs of its annotation."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.mesh_folders import find_meshes
from pipelines.dataset.meshes import read_own_mesh
from pipelines.dataset.symmetry.bop_models_info import ModelInfo, object_key
from pipelines.dataset.symmetry.symmetry_edits import ObjectEdits
from pipelines.errors import SymgraspError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.runtime.batch import WorkItem
from pipelines.storage.files import refuse_file_as_folder
from pipelines.storage.provenance import (
    digest,
    digest_if_there,
    digest_text,
    make_stamp,
    read_stamp,
)

STAGE = "annotate-symmetry"
Named = tuple[str, Path, "ObjectInputs"]  # name of an object, path of its annotation, inputs


@dataclass(frozen=True)
class ObjectInputs:
    """Inputs of an object's annotation; `refusal`: the reason why it cannot be annotated.

    `scale`: metres per unit of the mesh; None if nobody stated it.
    """

    mesh: Path
    regions: Path | None = None
    edits: ObjectEdits | None = None
    bop: ModelInfo | None = None
    refusal: str | None = None
    scale: float | None = None


def mesh_of(job: ObjectInputs) -> Mesh:
    """Read the mesh of an object."""
    return read_own_mesh(job.mesh, job.scale)


@dataclass(frozen=True)
class OptionalInputs:
    """Corrections by hand, and entries of BOP's file, of some objects; the unit of all meshes."""

    edits: dict[str, ObjectEdits] = field(default_factory=dict)
    bop: dict[str, ModelInfo] = field(default_factory=dict)
    scale: float | None = None


def items_of(
    source: Path,
    output_dir: Path | None,
    config: AnnotateSymmetryConfig,
    seed: int,
    optional: OptionalInputs,
) -> list[WorkItem]:
    """Return the items of a dataset root, or of a mesh or a folder of meshes.

    Raises:
        SymgraspError: there is nothing to annotate, or no output folder.
    """
    jobs = _dataset_jobs(source, optional.scale)
    if jobs and output_dir is not None:
        raise SymgraspError(
            f"{source} is a dataset, whose symmetries are written to {source / 'symmetry'}; leave "
            "--out out, or make a root of links if the dataset is only read"
        )
    jobs = jobs or _mesh_jobs(source, output_dir)
    return [_item(name, target, job, config, seed, optional) for name, target, job in jobs]


def without_bop_entry(items: Sequence[WorkItem], path: Path, optional: OptionalInputs) -> list[str]:
    """Return the names of the items without an entry in BOP's file `path`.

    Raises:
        SymgraspError: no item has an entry, so the file is for other objects.
    """
    missing = [item.name for item in items if item.arguments[0].bop is None]
    if len(missing) == len(items):
        raise SymgraspError(
            f"{path} has no entry of {', '.join(missing)}; it has entries of "
            f"{', '.join(optional.bop) or 'no object'}, so give the file of these meshes"
        )
    return missing


def edits_of(target: Path) -> str | None:
    """Return the digest of the corrections in an annotation; None without corrections."""
    return _inputs_of(_stamp_in(target)).get("edits")


def is_to_correct(item: WorkItem) -> bool:
    """Return whether `item` is finished except for its corrections."""
    job: ObjectInputs = item.arguments[0]
    if job.edits is None:
        return False
    stamp, wanted = _stamp_in(item.target), item.stamp.as_json()
    same = all(stamp.get(key) == wanted[key] for key in ("stage", "config", "seed"))
    found, undone = _inputs_of(stamp), {"edits": None}
    same &= {**found, **undone} == {**wanted["inputs"], **undone}
    return same and found.get("edits") != job.edits.digest


def _stamp_in(annotation: Path) -> dict[str, Any]:
    """Return the stamp in a file; empty without a stamp, or if the file is no annotation."""
    try:
        return (read_stamp(annotation) or {}) if annotation.is_file() else {}
    except SymgraspError:  # processing the item reports it
        return {}


def _inputs_of(stamp: Mapping[str, Any]) -> dict[str, Any]:
    """Return the inputs of a stamp; empty if a stamp written by hand has no inputs."""
    inputs = stamp.get("inputs")
    return inputs if isinstance(inputs, dict) else {}


def _dataset_jobs(source: Path, scale: float | None) -> list[Named]:
    if not (source / "models").is_dir():
        return []
    if scale not in (None, 1.0):
        raise SymgraspError(
            f"{source} is a dataset, whose meshes every stage takes as metres; "
            "--mesh-scale is for loose meshes"
        )
    root = GraspNetRoot.finished(source)
    jobs = []
    for object_id in root.checked_object_ids():
        regions = root.region_path(object_id)
        job = ObjectInputs(root.model_path(object_id), regions if regions.is_file() else None)
        jobs.append((f"{object_id:03d}", root.symmetry_path(object_id), job))
    return jobs


def _mesh_jobs(source: Path, output_dir: Path | None) -> list[Named]:
    if not source.exists():
        raise SymgraspError(f"{source} does not exist; give a dataset root, a mesh or a folder")
    if output_dir is None:
        raise SymgraspError(
            f"{source} holds no models/ folder, so it is no dataset; pass --out for loose meshes"
        )
    refuse_file_as_folder(output_dir)
    meshes = find_meshes(source)
    count = Counter(path.stem for path in meshes)
    jobs = []
    for path in meshes:
        name, refusal = path.stem, None
        if count[name] > 1:
            found = f"{path} shares its name with another mesh of the folder"
            name, refusal = path.name, f"{found}, and both would be {path.stem}.json; rename one"
        jobs.append((name, output_dir / f"{name}.json", ObjectInputs(path, refusal=refusal)))
    return jobs


def _item(
    name: str,
    target: Path,
    job: ObjectInputs,
    config: AnnotateSymmetryConfig,
    seed: int,
    optional: OptionalInputs,
) -> WorkItem:
    key = object_key(name)
    bop = optional.bop.get(name, optional.bop.get(key or ""))
    job = replace(job, edits=optional.edits.get(name), bop=bop, scale=optional.scale)
    # A missing mesh fails its own item, when it is read.
    inputs = {"mesh": digest_if_there(job.mesh)}
    inputs |= {} if job.regions is None else {"regions": digest(job.regions)}
    inputs |= {} if bop is None else {"bop": digest_text(repr(bop))}
    edits = edits_of(target) if job.edits is None else job.edits.digest
    # Without new corrections, an annotation with earlier corrections counts as finished.
    inputs |= {} if edits is None else {"edits": edits}
    settings = {"mesh_scale": optional.scale or 1.0, **asdict(config)}
    return WorkItem(name, target, make_stamp(STAGE, settings, seed=seed, inputs=inputs), (job,))
