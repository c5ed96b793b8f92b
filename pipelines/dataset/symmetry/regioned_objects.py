"""Objects of a dataset with their symmetric regions: a mesh and `symmetry/NNN.json`."""

from functools import lru_cache
from pathlib import Path

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import read_mesh
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.symmetry.regions import check_triangles
from pipelines.errors import FormatError, MissingInputError
from pipelines.geometry.region_masks import ObjectRegion, RegionedObject
from pipelines.storage.provenance import digest, read_stamp


def read_regioned_object(root: Path, object_id: int) -> RegionedObject:
    """Read an object of the dataset `root`; cached until one of its files changes.

    Raises:
        MissingInputError: `annotate-symmetry` has not been run.
        FormatError: a region has triangles that are not in the mesh or in another region too; or
            another mesh was annotated.
    """
    files = GraspNetRoot(root)
    mesh, labels = files.model_path(object_id), files.symmetry_path(object_id)
    if not labels.is_file():
        raise MissingInputError(labels, "symgrasp annotate-symmetry")
    return _read(mesh, labels, _version(mesh), _version(labels))


def _version(path: Path) -> tuple[int, int]:
    if not path.is_file():
        return 0, 0  # reading the file raises the error
    status = path.stat()
    return status.st_mtime_ns, status.st_size


@lru_cache(maxsize=32)
def _read(
    mesh_path: Path, labels_path: Path, _mesh: tuple[int, int], _labels: tuple[int, int]
) -> RegionedObject:
    mesh, labels = read_mesh(mesh_path), symmetry_labels.read(labels_path)
    _check_mesh(mesh_path, labels_path)
    check_triangles(labels_path, ((r.name, r.triangles) for r in labels.regions), mesh)
    regions = tuple(
        ObjectRegion(region.name, region.triangles, region.symmetries)
        for region in labels.regions
        if len(region.triangles)
    )
    return RegionedObject(mesh, regions)


def _check_mesh(mesh: Path, labels: Path) -> None:
    """Refuse labels of another mesh, since their triangle indices mean other triangles here.

    Labels written by hand need not have a stamp.
    """
    inputs = (read_stamp(labels) or {}).get("inputs")
    made_of = inputs.get("mesh") if isinstance(inputs, dict) else None
    if made_of is not None and made_of != digest(mesh):
        raise FormatError(
            labels, f"its regions are those of another mesh than {mesh}", "annotate it again"
        )
