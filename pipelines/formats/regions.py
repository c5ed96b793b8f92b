"""`regions/NNN.json`: symmetric regions given by hand; they override what is found (D. 10).

    {"regions": [{"name": "handle",
                  "box": [[x0, y0, z0], [x1, y1, z1]],    metres, object frame, or
                  "triangles": [0, 1, ...],               indices into the mesh
                  "symmetries": [...]}]}                  as in symmetry/NNN.json, optional

A box takes the triangles whose centroid lies in it. Without `symmetries` they are searched for.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError
from pipelines.formats.files import read_json
from pipelines.formats.symmetry_labels import symmetries_from_json, triangles_from_json
from pipelines.geometry.mesh import Mesh
from pipelines.geometry.symmetry import Symmetry


@dataclass(frozen=True)
class ManualRegion:
    """A region given by hand; `symmetries` is None where they are to be found."""

    name: str
    triangles: NDArray[np.int64]  # (k,)
    symmetries: tuple[Symmetry, ...] | None = None


def read(path: Path, mesh: Mesh) -> list[ManualRegion]:
    """Read the hand-written regions of `mesh`, object frame, metres.

    Raises:
        FormatError: not such a file, or a region without triangles of the mesh.
    """
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("regions"), list):
        raise FormatError(path, "lacks the list `regions`", '{"regions": [...]} is expected')
    return [_region(path, mesh, entry) for entry in content["regions"]]


def _region(path: Path, mesh: Mesh, entry: Any) -> ManualRegion:  # noqa: ANN401 - JSON
    if not isinstance(entry, dict) or ("triangles" in entry) == ("box" in entry):
        raise FormatError(path, "a region is not right", "it has either `triangles` or `box`")
    name = str(entry.get("name", "region"))
    triangles = (
        _in_box(path, mesh, entry)
        if "box" in entry
        else triangles_from_json(path, entry["triangles"])
    )
    if len(triangles) == 0 or triangles.max() >= len(mesh.faces):
        raise FormatError(
            path,
            f"region {name!r} has no triangles, or some beyond the mesh",
            f"the mesh has {len(mesh.faces)}",
        )
    stated = entry.get("symmetries")
    return ManualRegion(
        name, triangles, None if stated is None else symmetries_from_json(path, stated)
    )


def _in_box(path: Path, mesh: Mesh, entry: Mapping[str, Any]) -> NDArray[np.int64]:
    try:
        low, high = np.asarray(entry["box"], dtype=np.float64).reshape(2, 3)
    except (TypeError, ValueError) as error:
        raise FormatError(path, f"a box is not right ({error})", "two corners, metres") from error
    centroids = mesh.vertices[mesh.faces].mean(axis=1)
    inside = ((centroids >= low) & (centroids <= high)).all(axis=1)
    return np.flatnonzero(inside).astype(np.int64)
