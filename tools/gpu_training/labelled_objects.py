"""Labelled objects of dataset roots in one small file for a GPU host: 37 KB per object.

`python -m tools.gpu_training.labelled_objects OUT.xz ROOT [ROOT ...]` writes it. Each ROOT has its
`symmetry/` and `affordance/`. Coordinates are 16-bit whole numbers over the object's box.
"""

import argparse
import io
import json
import lzma
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.configs import EndlessConfig
from pipelines.contents import reason
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import FormatError, ValueRangeError, counted, errors_as_sentences
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.region_masks import RegionedObject
from pipelines.geometry.symmetry import (
    ObjectRegion,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.grasping.labelled_regions import LabelledSurface
from pipelines.storage.array_files import DAMAGED
from pipelines.storage.files import existing, write_bytes
from pipelines.synthesis.endless import (
    EndlessScenes,
    LabelledObject,
    read_object,
    trainable_objects,
)
from pipelines.synthesis.scenes.tables import SceneObject

WRITTEN_BY = "python -m tools.gpu_training.labelled_objects"
STEPS = 65535  # steps of a coordinate over the object's box
SURFACE_POINTS = 2048  # per object; labels have 4,096
MOST_PIECE_VERTICES = 6000  # vertices of all convex pieces; objects with more are left out


def write(path: Path, roots: list[Path]) -> int:
    """Write the objects of `roots` that are not held out for evaluation; return their number."""
    columns: dict[str, list[Any]] = {}
    labels = []
    for root in roots:
        files = GraspNetRoot(root)
        for object_id in trainable_objects(files):
            each = read_object(files, object_id)
            if sum(len(piece.vertices) for piece in each.scene.pieces) <= MOST_PIECE_VERTICES:
                for name, rows in _rows(each).items():
                    columns.setdefault(name, []).append(rows)
                labels.append([_region_record(region) for region in each.regioned.regions])
    arrays = {name: np.concatenate(rows) for name, rows in columns.items()}
    arrays["regions"] = np.frombuffer(json.dumps(labels).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    write_bytes(path, lzma.compress(buffer.getvalue(), preset=6))
    return len(labels)


def _rows(each: LabelledObject) -> dict[str, NDArray[Any]]:
    mesh, pieces = each.scene.mesh, list(each.scene.pieces)
    points = np.asarray(each.surface.tree.data)
    # The label lists its points by triangle, so that an even sample covers the whole surface.
    sample = np.linspace(0, len(points) - 1, min(SURFACE_POINTS, len(points))).astype(np.int64)
    places = [mesh.vertices, points[sample], *(piece.vertices for piece in pieces)]
    low, high = np.concatenate(places).min(axis=0), np.concatenate(places).max(axis=0)
    whole = [np.round((p - low) / _span(low, high) * STEPS).astype(np.uint16) for p in places]
    return {
        "vertices": whole[0],
        # Scanned meshes may have more vertices than 16 bits can number.
        "faces": mesh.faces.astype(np.uint16 if len(mesh.vertices) <= STEPS else np.uint32),
        "surface": whole[1],
        "affordance": np.round(255 * each.surface.affordance[sample]).astype(np.uint8),
        "piece_vertices": np.concatenate(whole[2:]),
        "piece_faces": np.concatenate([piece.faces for piece in pieces]).astype(np.uint16),
        "piece_counts": np.array([[len(p.vertices), len(p.faces)] for p in pieces]),
        "counts": np.array([[len(mesh.vertices), len(mesh.faces), len(sample), len(pieces)]]),
        "box": np.array([[low, high]]),
    }


def read(path: Path) -> dict[int, LabelledObject]:
    """Return the objects of a file of `write`, numbered from 0.

    Raises:
        MissingInputError: there is no such file.
        FormatError: the file is damaged, or holds something else.
    """
    packed = existing(path, WRITTEN_BY).read_bytes()
    try:
        with np.load(io.BytesIO(lzma.decompress(packed)), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        labels, taken = json.loads(arrays["regions"].tobytes()), _Columns(arrays)
        return {n: _object(n, taken, regions) for n, regions in enumerate(labels)}
    except (*DAMAGED, lzma.LZMAError) as error:
        found = f"holds no labelled objects ({reason(error)})"
        raise FormatError(path, found, f"a file of `{WRITTEN_BY}` is expected") from error


class _Columns:
    """Reader of arrays from their start, some rows at a time."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        self._arrays, self._at = arrays, dict.fromkeys(arrays, 0)

    def __call__(self, name: str, count: int = 1) -> NDArray[Any]:
        start = self._at[name]
        self._at[name] = start + count
        return self._arrays[name][start : start + count]


def _object(number: int, taken: _Columns, regions: list[Any]) -> LabelledObject:
    vertices, faces, points, pieces = taken("counts")[0].tolist()
    low, high = taken("box")[0]

    def places(name: str, count: int) -> Array:
        return low + taken(name, count) / STEPS * _span(low, high)

    mesh = Mesh(places("vertices", vertices), taken("faces", faces).astype(np.int64))
    surface = LabelledSurface.of(
        {
            "points": places("surface", points).astype(np.float32),
            "affordance": (taken("affordance", points) / 255).astype(np.float32),
        }
    )
    convex = [
        Mesh(places("piece_vertices", v), taken("piece_faces", f).astype(np.int64))
        for v, f in taken("piece_counts", pieces).tolist()
    ]
    scene = SceneObject(number, f"{number:04d}", mesh, convex)
    return LabelledObject(scene, RegionedObject(mesh, tuple(_regions(regions))), surface)


def _span(low: Array, high: Array) -> Array:
    return np.maximum(high - low, 1e-9)


def _region_record(region: ObjectRegion) -> list[Any]:
    steps = np.diff(np.sort(region.triangles), prepend=0).tolist()
    return [region.name, steps, [_symmetry_record(each) for each in region.symmetries]]


def _symmetry_record(symmetry: Symmetry) -> list[Any]:
    kind, point = type(symmetry).__name__, np.asarray(symmetry.point).tolist()
    if isinstance(symmetry, SphereSymmetry):
        return [kind, point]
    direction = np.asarray(symmetry.direction).tolist()
    order = symmetry.order if isinstance(symmetry, RotationSymmetry) else None
    return [kind, point, direction, order]


def _regions(records: list[Any]) -> Iterator[ObjectRegion]:
    for name, steps, symmetries in records:
        triangles = np.cumsum(steps).astype(np.int64)
        yield ObjectRegion(name, triangles, tuple(_symmetry(*each) for each in symmetries))


def _symmetry(
    kind: str, point: list[float], direction: list[float] | None = None, order: int | None = None
) -> Symmetry:
    if kind == SphereSymmetry.__name__:
        return SphereSymmetry(np.array(point))
    if kind == RotationSymmetry.__name__:
        return RotationSymmetry(np.array(direction), np.array(point), order)
    return ReflectionSymmetry(np.array(direction), np.array(point))


def scenes_of_file(path: Path, seed: int, limit: int | None = None) -> EndlessScenes:
    """Return endless scenes of the first `limit` objects of a file of `write`.

    Raises:
        ValueRangeError: there are no such objects.
    """
    objects = dict(list(read(path).items())[:limit])
    if not objects:
        raise ValueRangeError(f"number of objects to render of {path}", 0, "at least 1")
    return EndlessScenes(objects, EndlessConfig(), seed)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("roots", type=Path, nargs="+")
    options = parser.parse_args()
    with errors_as_sentences():
        count = write(options.out, options.roots)
    sys.stdout.write(f"{counted(count, 'object')}\n")
