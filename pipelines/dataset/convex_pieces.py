"""Convex pieces for physics, metres: of an object, or of the surroundings of a scene's objects.

`models/NNN/convex.npz` is in the object frame, `scenes/scene_NNNN/surroundings.npz` in the table's.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipelines.geometry.meshes.mesh import Mesh
from pipelines.storage.array_files import read_npz, write_npz

ARRAYS = ("vertices", "faces", "vertex_start", "face_start")


def write(path: Path, pieces: Sequence[Mesh]) -> None:
    """Write `pieces`: vertices and faces concatenated, with the start of each piece."""
    write_npz(
        path,
        vertices=np.concatenate([piece.vertices for piece in pieces]),
        faces=np.concatenate([piece.faces for piece in pieces]),
        vertex_start=np.cumsum([0, *(len(piece.vertices) for piece in pieces)]),
        face_start=np.cumsum([0, *(len(piece.faces) for piece in pieces)]),
    )


def read(path: Path) -> list[Mesh]:
    """Read a file of `write`."""
    arrays = read_npz(path, ARRAYS)
    v, f = arrays["vertex_start"], arrays["face_start"]
    return [
        Mesh(arrays["vertices"][v[i] : v[i + 1]], arrays["faces"][f[i] : f[i + 1]])
        for i in range(len(v) - 1)
    ]
