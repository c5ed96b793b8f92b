"""Objects of a dataset with their symmetric regions: a mesh and `symmetry/NNN.json`."""

from functools import lru_cache
from pathlib import Path

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import read_mesh
from pipelines.dataset.stale_labels import refuse_labels_of_another
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.symmetry.regions import check_triangles
from pipelines.geometry.region_masks import RegionedObject
from pipelines.storage.files import existing
from pipelines.storage.provenance import FileVersion


def read_regioned_object(root: Path, object_id: int) -> RegionedObject:
    """Read an object of the dataset `root`; cached until one of its files changes.

    Raises:
        MissingInputError: `annotate-symmetry` has not been run.
        FormatError: a region has triangles outside of the mesh or in another region, or the
            annotation is of another mesh.
    """
    files = GraspNetRoot(root)
    mesh, labels = files.model_path(object_id), files.symmetry_path(object_id)
    existing(labels, "symgrasp annotate-symmetry")
    return _read(FileVersion.of(mesh), FileVersion.of(labels))


@lru_cache(maxsize=32)
def _read(mesh_file: FileVersion, labels_file: FileVersion) -> RegionedObject:
    mesh, labels = read_mesh(mesh_file.path), symmetry_labels.read(labels_file.path)
    refuse_labels_of_another("mesh", mesh_file.path, labels_file.path, "annotate it again")
    check_triangles(labels_file.path, ((r.name, r.triangles) for r in labels.regions), mesh)
    return RegionedObject(mesh, tuple(r for r in labels.regions if len(r.triangles)))
