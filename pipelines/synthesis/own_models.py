"""The meshes that scenes are made of instead of procedural objects, and how large they are."""

from dataclasses import dataclass
from pathlib import Path

from pipelines.errors import SymgraspError
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.formats.meshes import MESH_SUFFIXES, find_meshes, read_solid_mesh, size_warning
from pipelines.formats.provenance import digest
from pipelines.geometry.mesh import Mesh


@dataclass(frozen=True)
class OwnModel:
    """One mesh of a user's.

    Attributes:
        name: of the object.
        path: of its file.
        scale: metres a unit of the file; None is 1, and refuses what is too large for that.
    """

    name: str
    path: Path
    scale: float | None

    @property
    def inputs(self) -> dict[str, str]:
        """The digest of the mesh, by a name that no other mesh has."""
        key = self.path.name if self.name == self.path.stem else f"{self.name}/{self.path.name}"
        return {key: digest(self.path)}

    def read(self) -> Mesh:
        """Return the mesh in metres, looking outward.

        Raises:
            SymgraspError: it cannot be read, or seems to be in millimetres.
        """
        mesh = read_solid_mesh(self.path, self.scale or 1.0)
        too_large = size_warning(mesh, self.path) if self.scale is None else None
        if too_large:
            raise SymgraspError(f"{too_large}; if it is in metres, say so: --mesh-scale 1")
        return mesh


def own_models(source: Path, scale: float | None) -> list[OwnModel]:
    """List the meshes of `source`: one mesh, a folder of meshes, a dataset root or its models/.

    Raises:
        SymgraspError: there are none, or two of one name.
    """
    if not source.exists():
        raise SymgraspError(f"{source} does not exist; give a mesh, a folder of meshes or a root")
    root = source if (source / "models").is_dir() else source.parent
    paths = find_meshes(source) if source.is_dir() else [source]
    found = [OwnModel(path.stem, path, scale) for path in paths]
    if not found and (root / "models").is_dir() and source in (root, root / "models"):
        models = GraspNetRoot(root)
        found = [
            OwnModel(f"{i:03d}", path, scale)
            for i in models.object_ids()
            if (path := models.model_path(i)).is_file()
        ]
    if not found:
        kinds = ", ".join(MESH_SUFFIXES)
        raise SymgraspError(f"{source} holds no meshes; files ending in {kinds} are read")
    return found
