"""Object ids of meshes in a dataset root, kept in ROOT/objects.json from run to run."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipelines.dataset import object_list
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.mesh_folders import find_meshes
from pipelines.dataset.object_list import ObjectRecord
from pipelines.errors import ValueRangeError
from pipelines.storage.provenance import make_stamp

MAX_IDS = 1000  # ids have three digits


@dataclass(frozen=True)
class NumberedMesh:
    """One mesh and its object id in a root."""

    object_id: int
    name: str
    path: Path

    @property
    def title(self) -> str:
        """Name of the object in reports."""
        number = f"{self.object_id:03d}"
        return number if self.name == number else f"{number} {self.name}"


def numbered_meshes(meshes: Path, output: Path) -> list[NumberedMesh]:
    """Return the meshes of `meshes` with their ids in the root `output`.

    Meshes listed in objects.json keep their ids; `meshes` may be a root itself.

    Raises:
        ValueRangeError: there are more meshes than ids.
    """
    if (meshes / "models").is_dir():
        root = GraspNetRoot(meshes)
        names = {record.object_id: record.name for record in _records(meshes)}
        return [
            NumberedMesh(i, names.get(i, f"{i:03d}"), root.model_path(i)) for i in root.object_ids()
        ]
    paths = find_meshes(meshes)
    records = _records(output)
    known = {str(r.details["file"]): r.object_id for r in records if "file" in r.details}
    taken = {record.object_id for record in records}
    free = iter([number for number in range(MAX_IDS) if number not in taken])
    numbers = {path.name: known[path.name] for path in paths if path.name in known}
    numbers |= dict(zip([p.name for p in paths if p.name not in known], free, strict=False))
    if len(numbers) < len(paths):
        raise ValueRangeError("number of meshes", f"above {MAX_IDS}", f"at most {MAX_IDS} a root")
    return [NumberedMesh(numbers[path.name], path.stem, path) for path in paths]


def write_object_list(
    meshes: Path, output: Path, sources: Sequence[NumberedMesh], stage: str
) -> None:
    """Write objects.json of the root `output`: its earlier records, and the objects of a run.

    `meshes`: as in `numbered_meshes`. `stage`: named in the stamp.
    """
    records = {record.object_id: record for record in _records(output)}
    described = {record.object_id: record for record in _records(meshes)}
    for source in sources:
        record = ObjectRecord(
            source.object_id, source.name, source.name, "models", details={"file": source.path.name}
        )
        records[source.object_id] = described.get(source.object_id, record)
    files = {f"{r.object_id:03d}": str(r.details.get("file", r.name)) for r in records.values()}
    stamp = make_stamp(f"{stage} object list", {"files": files})
    object_list.write(output / "objects.json", list(records.values()), stamp)


def _records(root: Path) -> list[ObjectRecord]:
    path = root / "objects.json"
    return object_list.read(path) if path.is_file() else []
