"""`regions/NNN.json`: symmetric regions given by hand, which override detected regions (D. 10).

    {"regions": [{"name": "handle",
                  "box": [[x0, y0, z0], [x1, y1, z1]],    metres, object frame, or
                  "triangles": [0, 1, ...],               indices into the mesh
                  "symmetries": [...]}]}                  as in symmetry/NNN.json, optional

A box selects the triangles with centroid inside. Without `symmetries`, they are detected.
A triangle is in at most one region; triangles in no region belong to no mask.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.array_types import Indices
from pipelines.contents import reading
from pipelines.dataset.symmetry.symmetry_labels import symmetries_from_json, triangles_from_json
from pipelines.errors import FormatError, counted
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import Symmetry
from pipelines.storage.files import read_json


@dataclass(frozen=True)
class ManualRegion:
    """A region given by hand; if `symmetries` is None, symmetries are detected."""

    name: str
    triangles: Indices  # (k,)
    symmetries: tuple[Symmetry, ...] | None = None


def read(path: Path, mesh: Mesh) -> list[ManualRegion]:
    """Read the hand-written regions of `mesh`, object frame, metres.

    Raises:
        FormatError: the file is malformed, a region has no triangles, or regions share triangles.
    """
    content = read_json(path, by_hand=True)
    if not isinstance(content, dict) or not isinstance(content.get("regions"), list):
        raise FormatError(path, "lacks the list `regions`", '{"regions": [...]} is expected')
    if not content["regions"]:
        raise FormatError(path, "`regions` is empty", "list a region, or delete the file")
    regions = [_region(path, mesh, entry) for entry in content["regions"]]
    check_triangles(path, ((region.name, region.triangles) for region in regions), mesh)
    return regions


def check_triangles(path: Path, regions: Iterable[tuple[str, Indices]], mesh: Mesh) -> None:
    """Refuse regions (name, triangles) of the file `path` that do not fit `mesh`.

    Raises:
        FormatError: a triangle is beyond the mesh, twice in a region, or in two regions.
    """
    count = len(mesh.faces)
    owner = np.full(count, "", dtype=object)
    for name, triangles in regions:
        if len(triangles) and triangles.max() >= count:
            found = f"region {name!r} names triangle {triangles.max()}, beyond the mesh"
            raise FormatError(path, found, f"the mesh has {count}, numbered from 0")
        if len(np.unique(triangles)) < len(triangles):
            raise FormatError(path, f"region {name!r} names a triangle twice", "name it once")
        shared = triangles[owner[triangles] != ""]
        if len(shared):
            number = counted(len(shared), "triangle")
            raise FormatError(
                path,
                f"regions {owner[shared[0]]!r} and {name!r} share {number}, {shared[0]} the first",
                "a triangle is in one region at most",
            )
        owner[triangles] = name or "?"


def _region(path: Path, mesh: Mesh, entry: Any) -> ManualRegion:  # noqa: ANN401 - JSON
    if not isinstance(entry, dict) or ("triangles" in entry) == ("box" in entry):
        raise FormatError(path, "a region is malformed", "either `triangles` or `box` is expected")
    name = str(entry.get("name", "region"))
    if "box" in entry:
        triangles, which = _in_box(path, mesh, entry), "its box holds none: metres, object frame?"
    else:
        triangles, which = triangles_from_json(path, entry["triangles"]), "list some, or drop it"
    if len(triangles) == 0:
        raise FormatError(path, f"region {name!r} has no triangles", which)
    stated = entry.get("symmetries")
    if stated is not None and not isinstance(stated, list):
        found = f"`symmetries` of region {name!r} are no list"
        raise FormatError(path, found, "a list is expected, or none")
    return ManualRegion(
        name, triangles, None if stated is None else symmetries_from_json(path, stated)
    )


def _in_box(path: Path, mesh: Mesh, entry: Mapping[str, Any]) -> Indices:
    with reading(path, "a box", "two corners, metres"):
        low, high = np.asarray(entry["box"], dtype=np.float64).reshape(2, 3)
    if not np.isfinite([low, high]).all() or (low > high).any():
        raise FormatError(path, "a box's corners are wrong", "the lower corner first, metres")
    centroids = mesh.vertices[mesh.faces].mean(axis=1)
    inside = ((centroids >= low) & (centroids <= high)).all(axis=1)
    return np.flatnonzero(inside).astype(np.int64)
