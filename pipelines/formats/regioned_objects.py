"""The objects of a dataset with their symmetric regions: a mesh and `symmetry/NNN.json`."""

from functools import lru_cache
from pathlib import Path

from pipelines.errors import FormatError, MissingInputError
from pipelines.formats import symmetry_labels
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.formats.meshes import read_mesh
from pipelines.geometry.region_masks import ObjectRegion, RegionedObject


@lru_cache(maxsize=256)
def read_regioned_object(root: Path, object_id: int) -> RegionedObject:
    """Read an object of the dataset `root`; read once and kept.

    Raises:
        MissingInputError: `annotate-symmetry` has not been run.
        FormatError: a region has triangles that the mesh lacks.
    """
    files = GraspNetRoot(root)
    path = files.symmetry_path(object_id)
    if not path.is_file():
        raise MissingInputError(path, "symgrasp annotate-symmetry")
    mesh, labels = read_mesh(files.model_path(object_id)), symmetry_labels.read(path)
    for region in labels.regions:
        if len(region.triangles) and region.triangles.max() >= len(mesh.faces):
            raise FormatError(
                path,
                f"region {region.name!r} names triangles beyond the mesh",
                f"the mesh has {len(mesh.faces)}; annotate it again",
            )
    regions = tuple(
        ObjectRegion(region.name, region.triangles, region.symmetries)
        for region in labels.regions
        if len(region.triangles)
    )
    return RegionedObject(mesh, regions)
