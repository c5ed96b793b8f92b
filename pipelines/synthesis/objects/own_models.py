"""A user's meshes, for scenes without procedural objects, and their scale."""

from dataclasses import dataclass
from pathlib import Path

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.mesh_folders import find_meshes
from pipelines.dataset.meshes import (
    read_own_mesh,
    refuse_too_small,
    solid,
)
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.storage.files import real_path
from pipelines.synthesis.objects.decomposition import physics_pieces
from pipelines.synthesis.objects.pools import SyntheticObject
from pipelines.synthesis.scenes.settling import refuse_bodiless


@dataclass(frozen=True)
class OwnModel:
    """One mesh of a user."""

    name: str
    path: Path
    scale: float | None  # metres per unit; None means 1 and refuses implausibly large meshes

    def as_object(self, seed: int) -> SyntheticObject:
        """Return the object for scenes, cut into convex pieces with `seed`.

        Raises:
            SymgraspError: the mesh cannot be read, seems to be in millimetres, is tiny, or is no
                body for physics, such as a sheet.
        """
        mesh = solid(read_own_mesh(self.path, self.scale), self.path)
        refuse_too_small(mesh, self.path)
        try:
            pieces = physics_pieces(mesh, seed=seed)
            refuse_bodiless(pieces)
        except SymgraspError as error:
            raise SymgraspError(f"{self.path}: {error}") from error
        return SyntheticObject(self.name, self.name, mesh, (), pieces)


def refuse_own_output(source: Path, output: Path) -> None:
    """Raise ValueRangeError if the meshes of `source` are in the dataset `output` to be written.

    The models of this dataset would be renumbered, and their labels replaced.
    """
    here, there = real_path(source), real_path(output)
    if here == there or here.is_relative_to(there / "models"):
        expected = (
            "outside of OUT, where models would be renumbered and labels replaced; "
            "name another folder as OUT"
        )
        raise ValueRangeError("--models", source, expected)


def own_models(source: Path, scale: float | None) -> list[OwnModel]:
    """List the meshes of `source`: one mesh, a folder of meshes, a dataset root or its models/.

    Raises:
        SymgraspError: there are no meshes.
    """
    root = GraspNetRoot(source if (source / "models").is_dir() else source.parent)
    of_root = source in (root.root, root.root / "models") and (root.root / "models").is_dir()
    ids = root.object_ids() if of_root else []
    found = [OwnModel(f"{i:03d}", root.model_path(i), scale) for i in ids]
    return found or [OwnModel(path.stem, path, scale) for path in find_meshes(source)]
