"""`symmetry/NNN.json`: the symmetries of an object and of its regions, canonical frame, metres."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.array_types import Indices
from pipelines.contents import reading
from pipelines.errors import FormatError, UnknownNameError, ValueRangeError
from pipelines.geometry.symmetry import (
    SYMMETRY_KINDS,
    ObjectRegion,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.storage.files import read_json, write_json
from pipelines.storage.provenance import Stamp

FORMAT_VERSION = 1
LARGEST_INDEX = 2**31 - 1  # of a triangle
FOUND, BY_HAND, FROM_BOP = "found", "hand", "bop"  # sources of a symmetry


@dataclass(frozen=True)
class ObjectSymmetries:
    """The symmetries of a whole object, and its regions with their symmetries."""

    name: str  # name of the object
    symmetries: tuple[Symmetry, ...]  # symmetries of the whole object
    # Symmetric parts; a single region, the whole, if the object is symmetric. Triangles are indices
    # in the order of the mesh's file.
    regions: tuple[ObjectRegion, ...] = ()
    # Nearness of a decision to the opposite decision, 0 to 1; None if unknown.
    doubt: float | None = None
    rejected: tuple[Symmetry, ...] = ()  # candidates nearest to acceptance, nearest first
    # Source of each of `symmetries`: FOUND, BY_HAND or FROM_BOP; empty: all FOUND.
    sources: tuple[str, ...] = ()
    # `symmetries` before corrections by hand; None without corrections.
    found: tuple[Symmetry, ...] | None = None
    found_sources: tuple[str, ...] = ()  # source of each of `found`

    @property
    def all_sources(self) -> tuple[str, ...]:
        """Source of each symmetry."""
        return self.sources or (FOUND,) * len(self.symmetries)


def write(path: Path, labels: ObjectSymmetries, stamp: Stamp) -> None:
    """Write `labels` as JSON."""
    content = {
        "object": labels.name,
        "symmetries": _with_sources(labels.symmetries, labels.all_sources),
        "doubt": labels.doubt,
        "rejected": [symmetry_to_json(symmetry) for symmetry in labels.rejected],
        "found": None
        if labels.found is None
        else _with_sources(labels.found, labels.found_sources or (FOUND,) * len(labels.found)),
        "regions": [region_to_json(region) for region in labels.regions],
        "format_version": FORMAT_VERSION,
        "provenance": stamp.as_json(),
    }
    write_json(path, content)


def read(path: Path) -> ObjectSymmetries:
    """Read a symmetry file, from this toolkit or written by hand.

    Raises:
        FormatError: the file is malformed; the message names the entry.
    """
    content = read_json(path, by_hand=True)
    if not isinstance(content, dict) or "symmetries" not in content:
        raise FormatError(path, "lacks `symmetries`", "object, symmetries and regions are expected")
    doubt, found = content.get("doubt"), content.get("found")
    with reading(path, "an entry", "object, symmetries and regions are expected"):
        return ObjectSymmetries(
            name=str(content.get("object", path.stem)),
            symmetries=symmetries_from_json(path, content["symmetries"]),
            regions=tuple(_region(path, region) for region in content.get("regions", [])),
            doubt=doubt if isinstance(doubt, float | int) and np.isfinite(doubt) else None,
            rejected=symmetries_from_json(path, content.get("rejected", [])),
            sources=_sources(content["symmetries"]),
            found=None if found is None else symmetries_from_json(path, found),
            found_sources=() if found is None else _sources(found),
        )


def _with_sources(symmetries: Sequence[Symmetry], sources: Sequence[str]) -> list[dict[str, Any]]:
    return [
        symmetry_to_json(symmetry) | {"source": source}
        for symmetry, source in zip(symmetries, sources, strict=True)
    ]


def _sources(entries: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    return tuple(str(entry.get("source", FOUND)) for entry in entries)


def symmetry_to_json(symmetry: Symmetry) -> dict[str, Any]:
    """Return one symmetry as a JSON object; floats keep all their digits."""
    content: dict[str, Any] = {"kind": symmetry.kind}
    match symmetry:
        case ReflectionSymmetry():
            content["normal"] = symmetry.normal.tolist()
        case RotationSymmetry():
            content["axis"] = symmetry.axis.tolist()
    content["point"] = symmetry.point.tolist()
    if isinstance(symmetry, RotationSymmetry):
        content["order"] = symmetry.order
    content["error"] = float(symmetry.error)
    return content


def symmetries_from_json(path: Path, content: Sequence[Any]) -> tuple[Symmetry, ...]:
    """Return the symmetries of a JSON list; `path` is named in errors."""
    with reading(path, "a symmetry", "kind, normal or axis, point are expected"):
        return tuple(_symmetry(entry) for entry in content)


def region_to_json(region: ObjectRegion) -> dict[str, Any]:
    """Return one region as a JSON object."""
    return {
        "name": region.name,
        "triangles": np.asarray(region.triangles).tolist(),
        "symmetries": [symmetry_to_json(symmetry) for symmetry in region.symmetries],
    }


def triangles_from_json(path: Path, content: Any) -> Indices:  # noqa: ANN401 - JSON
    """Return triangle indices (k,) of a JSON list of integers."""
    whole = isinstance(content, list) and all(
        isinstance(i, int) and not isinstance(i, bool) and 0 <= i <= LARGEST_INDEX for i in content
    )
    if not whole:
        raise FormatError(path, "`triangles` of a region are wrong", "a list of indices from 0")
    return np.array(content, dtype=np.int64)


def _symmetry(entry: Mapping[str, Any]) -> Symmetry:
    error = float(entry.get("error", 0.0))
    if not np.isfinite(error):  # which JSON cannot hold
        raise ValueRangeError("error", error, "a finite number")
    match entry["kind"]:
        case "reflection":
            return ReflectionSymmetry(entry["normal"], entry["point"], error)
        case "rotation":
            order = _order(entry.get("order"))
            return RotationSymmetry(entry["axis"], entry["point"], order, error)
        case "sphere":
            return SphereSymmetry(entry["point"], error)
        case other:
            raise UnknownNameError("kind of symmetry", str(other), SYMMETRY_KINDS)


def _order(content: Any) -> int | None:  # noqa: ANN401 - JSON
    """Return an order; 4.0, as some programs write 4, counts as 4."""
    is_whole = (isinstance(content, int) and not isinstance(content, bool)) or (
        isinstance(content, float) and content.is_integer()
    )
    if content is not None and not is_whole:
        raise ValueRangeError("order", repr(content), "null (continuous) or a whole number from 2")
    return None if content is None else int(content)


def _region(path: Path, content: Any) -> ObjectRegion:  # noqa: ANN401 - JSON
    if not isinstance(content, dict) or "triangles" not in content:
        raise FormatError(path, "a region lacks `triangles`", "name, triangles, symmetries")
    return ObjectRegion(
        name=str(content.get("name", "region")),
        triangles=triangles_from_json(path, content["triangles"]),
        symmetries=symmetries_from_json(path, content.get("symmetries", [])),
    )
