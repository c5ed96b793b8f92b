"""Read and write triangle meshes: ply, obj, stl, off and glb in, binary ply and obj out.

Vertices are metres in the object frame. Triangles keep the order they have in the file, so that
triangle indices (symmetric regions) mean the same thing to every reader.
"""

import logging
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipelines.errors import FormatError, UnknownNameError
from pipelines.formats.files import existing, write_bytes
from pipelines.geometry.mesh import Mesh

log = logging.getLogger(__name__)

MESH_SUFFIXES = (".glb", ".obj", ".off", ".ply", ".stl")
LARGEST_LIKELY_EXTENT = 3.0  # m; what a gripper may hold is smaller, a file in mm is larger

PLY_HEADER = """ply
format binary_little_endian 1.0
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
"""


def read_mesh(path: Path) -> Mesh:
    """Read one mesh: metres, object frame, equal vertices merged, triangles in file order.

    Raises:
        FormatError: unreadable, without triangles, or with vertices that are not finite.
    """
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise UnknownNameError("mesh format", path.suffix, MESH_SUFFIXES)
    loaded = _load(existing(path))
    if len(loaded.faces) == 0:
        raise FormatError(path, "the mesh has no triangles", "give a triangle mesh")
    if not np.isfinite(loaded.vertices).all():
        raise FormatError(path, "a vertex is NaN or infinite", "finite metres are expected")
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    faces = np.asarray(loaded.faces, dtype=np.int64)
    vertices = np.asarray(loaded.vertices, dtype=np.float64)
    _warn_about_units(path, vertices)
    return Mesh(vertices, faces)


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Write `mesh` as binary ply or as obj, by the suffix of `path`; same mesh, same bytes."""
    match path.suffix.lower():
        case ".ply":
            write_bytes(path, _ply_bytes(mesh))
        case ".obj":
            write_bytes(path, _obj_text(mesh).encode("ascii"))
        case suffix:
            raise UnknownNameError("mesh format to write", suffix, (".obj", ".ply"))


def find_meshes(folder: Path) -> list[Path]:
    """List the mesh files directly in `folder`, sorted by name."""
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in MESH_SUFFIXES)


def _load(path: Path) -> trimesh.Trimesh:
    try:
        loaded = trimesh.load_mesh(path, process=False)
    except Exception as error:  # trimesh's parsers raise whatever they stumble over
        what = f"not readable as {path.suffix} ({type(error).__name__}: {error})"
        raise FormatError(path, what, "export the mesh again") from error
    if not isinstance(loaded, trimesh.Trimesh):
        raise FormatError(path, "the file holds points but no triangles", "give a triangle mesh")
    if len(loaded.faces) and not 0 <= loaded.faces.min() <= loaded.faces.max() < len(
        loaded.vertices
    ):
        raise FormatError(
            path, "a triangle names a vertex that is not there", "export the mesh again"
        )
    return loaded


def _warn_about_units(path: Path, vertices: NDArray[np.float64]) -> None:
    extent = float(np.ptp(vertices, axis=0).max())
    if extent > LARGEST_LIKELY_EXTENT:
        log.warning(
            "%s is %.4g m long: that looks like millimetres; scale the mesh to metres", path, extent
        )


def _ply_bytes(mesh: Mesh) -> bytes:
    header = PLY_HEADER.format(vertices=len(mesh.vertices), faces=len(mesh.faces))
    faces = np.zeros(len(mesh.faces), dtype=[("count", "u1"), ("indices", "<i4", (3,))])
    faces["count"] = 3
    faces["indices"] = mesh.faces
    vertices = np.asarray(mesh.vertices, dtype="<f4")
    return b"".join((header.encode("ascii"), vertices.tobytes(), faces.tobytes()))


def _obj_text(mesh: Mesh) -> str:
    # Nine significant digits name each float32 uniquely: ply and obj hold the same mesh.
    vertices = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.astype(np.float32)]
    faces = [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    return "\n".join([*vertices, *faces]) + "\n"
