"""`objects.json` of a synthesized dataset: families and exact symmetries of its objects."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipelines.contents import reading
from pipelines.dataset.symmetry.symmetry_labels import symmetries_from_json, symmetry_to_json
from pipelines.errors import FormatError
from pipelines.geometry.symmetry import Symmetry
from pipelines.storage.files import read_json, write_json
from pipelines.storage.provenance import Stamp

FORMAT_VERSION = 1


@dataclass(frozen=True)
class ObjectRecord:
    """One object of a dataset."""

    object_id: int
    name: str
    family: str  # such as "bottle"; the name of the mesh file for a user's own mesh
    pool: str = ""  # of `synthesize`, such as seen; models for a user's own mesh
    symmetries: tuple[Symmetry, ...] = ()  # exact, by construction; canonical frame, metres
    details: Mapping[str, Any] = field(default_factory=dict)  # JSON, such as its parameters


def write(path: Path, objects: Sequence[ObjectRecord], stamp: Stamp) -> None:
    """Write `objects` as JSON, ascending by id."""
    entries = [
        {
            "object_id": record.object_id,
            "name": record.name,
            "family": record.family,
            "pool": record.pool,
            "symmetries": [symmetry_to_json(symmetry) for symmetry in record.symmetries],
            "details": dict(record.details),
        }
        for record in sorted(objects, key=lambda record: record.object_id)
    ]
    content = {"objects": entries, "format_version": FORMAT_VERSION, "provenance": stamp.as_json()}
    write_json(path, content)


def read(path: Path) -> list[ObjectRecord]:
    """Read a file of `write`.

    Raises:
        FormatError: the file is no objects.json.
    """
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("objects"), list):
        raise FormatError(path, "lacks the list `objects`", "an objects.json is expected")
    with reading(path, "an object", "object_id, name, family are needed"):
        return [
            ObjectRecord(
                int(entry["object_id"]),
                str(entry["name"]),
                str(entry["family"]),
                str(entry.get("pool", "")),
                symmetries_from_json(path, entry.get("symmetries", [])),
                dict(entry.get("details", {})),
            )
            for entry in content["objects"]
        ]
