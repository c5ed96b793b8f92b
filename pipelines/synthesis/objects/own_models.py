"""The meshes that scenes are made of instead of procedural objects, and how large they are."""

from dataclasses import dataclass
from pathlib import Path

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import (
    find_meshes,
    read_solid_mesh,
    refuse_too_large,
    refuse_too_small,
)
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.synthesis.objects.decomposition import convex_pieces
from pipelines.synthesis.objects.pools import SyntheticObject
from pipelines.synthesis.scenes.settling import refuse_bodiless


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

    def read(self) -> Mesh:
        """Return the mesh in metres, looking outward.

        Raises:
            SymgraspError: it cannot be read, seems to be in millimetres, or is tiny.
        """
        mesh = read_solid_mesh(self.path, self.scale or 1.0)
        refuse_too_large(mesh, self.path, self.scale)
        refuse_too_small(mesh, self.path)
        return mesh

    def as_object(self, seed: int) -> SyntheticObject:
        """Return the object that scenes are made of, cut into convex pieces with `seed`.

        Raises:
            SymgraspError: as `read`, or physics cannot take it as a body, as a sheet.
        """
        mesh = self.read()
        try:
            pieces = convex_pieces(mesh, seed=seed)
            refuse_bodiless(pieces)
        except SymgraspError as error:
            raise SymgraspError(f"{self.path}: {error}") from error
        return SyntheticObject(self.name, self.name, mesh, (), pieces)


def refuse_own_output(source: Path, output: Path) -> None:
    """Raise ValueRangeError if meshes are to be taken from where the dataset `output` is written.

    Its models would be numbered anew, and their labels be made over.
    """
    here, there = source.resolve(), output.resolve()
    if here == there or here.is_relative_to(there / "models"):
        expected = (
            "outside of OUT, whose models and labels would be numbered and made anew; "
            "name another folder as OUT"
        )
        raise ValueRangeError("--models", source, expected)


def own_models(source: Path, scale: float | None) -> list[OwnModel]:
    """List the meshes of `source`: one mesh, a folder of meshes, a dataset root or its models/.

    Raises:
        SymgraspError: there are none.
    """
    root = GraspNetRoot(source if (source / "models").is_dir() else source.parent)
    of_root = source in (root.root, root.root / "models") and (root.root / "models").is_dir()
    ids = root.object_ids() if of_root else []
    found = [OwnModel(f"{i:03d}", root.model_path(i), scale) for i in ids]
    return found or [OwnModel(path.stem, path, scale) for path in find_meshes(source)]
