"""Files of triangle meshes: reads ply, obj, stl, off and glb, writes binary ply and obj.

Vertices are in metres, object frame. Triangles keep the order of the file, so that triangle indices
of symmetric regions are the same for every reader; of a PLY or OFF with polygons of more corners,
which each reader splits its own way, they do not. `clean_mesh` drops degenerate triangles, for
stages that write a mesh.
"""

import io
import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from pipelines.array_types import Array, Indices
from pipelines.contents import reason
from pipelines.errors import (
    FormatError,
    SymgraspError,
    UnknownNameError,
    ValueRangeError,
    counted,
)
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.winding import turned_outward
from pipelines.storage.files import existing, read_bytes, write_bytes

log = logging.getLogger(__name__)

MESH_SUFFIXES = (".glb", ".obj", ".off", ".ply", ".stl")
UNREAD_SUFFIXES = (
    *(".step", ".stp", ".iges", ".igs", ".brep", ".sldprt", ".ipt", ".prt", ".fcstd"),  # CAD
    *(".3mf", ".amf", ".dae", ".gltf", ".fbx", ".blend", ".3ds", ".usd", ".usda", ".usdc", ".usdz"),
    *(".x3d", ".wrl", ".vtk", ".vtp", ".ctm", ".abc"),
)
CONVERSION = "convert them: STEP and IGES by `gmsh NAME.step -2 -o NAME.stl`, others in Blender"
LARGEST_LIKELY_DIAGONAL = 2.0  # metres; graspable objects are smaller, files in mm are larger
SMALLEST_DIAGONAL = 0.005  # metres; no gripper holds and no depth camera sees a smaller object
MAX_MESH_BYTES = 2**29
MAX_TRIANGLES = 4_000_000  # of a file, with repetitions of instances; scans have some 200,000
MATERIAL_LINE = re.compile(rb"^usemtl\b.*$", re.MULTILINE)
COMMENT = re.compile(rb"#.*")
THINNEST_TRIANGLE = 1e-10  # height over longest edge; a thinner triangle has no reliable normal

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
    """Read a model of a dataset: metres, object frame, vertices merged, triangles in file order.

    A warning is logged for a mesh too large to be in metres.

    Raises:
        FormatError: the file is unreadable, has no triangles, or vertices that are not finite.
    """
    mesh = _read(path, 1.0)
    if warning := size_warning(mesh, path):
        log.warning("%s", warning)
    return mesh


def read_own_mesh(path: Path, scale: float | None) -> Mesh:
    """Read a mesh of unknown origin as `read_mesh` does.

    `scale`: metres per unit of the file, 0.001 for millimetres; None if nobody stated it.

    Raises:
        FormatError: the file is unreadable, has no triangles, or vertices that are not finite.
        SymgraspError: no `scale` was given, and the mesh is too large to be in metres.
    """
    mesh = _read(path, 1.0 if scale is None else scale)
    if scale is None and (warning := size_warning(mesh, path)):
        raise SymgraspError(
            f"{warning}: --mesh-scale 0.001 (millimetres) makes that {mesh.diagonal / 1000:.4g} m, "
            f"0.01 (centimetres) {mesh.diagonal / 100:.4g} m, and 1 states that it is in metres"
        )
    return mesh


def _read(path: Path, scale: float) -> Mesh:
    if path.suffix.lower() not in MESH_SUFFIXES:
        if path.suffix.lower() in UNREAD_SUFFIXES:
            kinds = ", ".join(MESH_SUFFIXES)
            raise FormatError(path, f"has a format that is not read; {kinds} are", CONVERSION)
        raise UnknownNameError("mesh format", path.suffix, MESH_SUFFIXES)
    loaded = _load(existing(path))
    if len(loaded.faces) == 0:
        found = "the mesh has no triangles, or its file is cut off"
        raise FormatError(path, found, "give a triangle mesh")
    if not np.isfinite(loaded.vertices).all():
        bad = int((~np.isfinite(loaded.vertices).all(axis=1)).sum())
        found = f"{bad} of {len(loaded.vertices)} vertices are NaN or infinite"
        raise FormatError(path, found, "finite metres are expected; export the mesh again")
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    faces = np.asarray(loaded.faces, dtype=np.int64)
    return Mesh(scale * np.asarray(loaded.vertices, dtype=np.float64), faces)


def read_solid_mesh(path: Path) -> Mesh:
    """Read a model as `read_mesh` does, with all triangles turned to face outward."""
    return solid(read_mesh(path), path)


def solid(mesh: Mesh, path: Path) -> Mesh:
    """Return the mesh of `path` with all triangles turned to face outward; the count is logged."""
    mesh, turned = turned_outward(mesh)
    if turned:
        warn_once(path, turned)
    return mesh


@lru_cache  # a dataset's model is read for each scene
def warn_once(path: Path, sentence: str) -> None:
    """Log `sentence` on `path` as a warning, once per process."""
    log.warning("%s: %s", path, sentence)


def read_vertices(path: Path) -> Array:
    """Read the points (n, 3) of a mesh or a cloud as in the file, without merging."""
    with _parsing(path):
        points = np.asarray(_geometry(path).vertices, dtype=np.float64)
    if len(points) == 0 or not np.isfinite(points).all():
        raise FormatError(
            path, "no points, or some that are not finite", "finite metres are expected"
        )
    return points


def refuse_too_small(mesh: Mesh, path: Path) -> None:
    """Raise SymgraspError if `mesh` is too small for physics and cameras."""
    if too_small := smallness_warning(mesh, path):
        raise SymgraspError(too_small)


def smallness_warning(mesh: Mesh, path: Path) -> str | None:
    """Return a warning if a mesh is too small to be grasped, with the option to pass; else None."""
    size = mesh.diagonal
    if size >= SMALLEST_DIAGONAL:
        return None
    return (
        f"{path}: the mesh is {1000 * size:.3g} mm from corner to corner, which is too small to "
        f"be held; at least {1000 * SMALLEST_DIAGONAL:g} mm are expected: --mesh-scale states how "
        "many metres a unit of the file is, 1 for metres, 0.001 for millimetres"
    )


def size_warning(mesh: Mesh, path: Path) -> str | None:
    """Return a warning if a mesh is too large to be in metres; else None."""
    size = mesh.diagonal
    if size <= LARGEST_LIKELY_DIAGONAL:
        return None
    return (
        f"{path}: the mesh is {size:.4g} m from corner to corner, which looks like millimetres "
        "or centimetres; metres are expected"
    )


def clean_mesh(mesh: Mesh) -> tuple[Mesh, Indices, str]:
    """Drop triangles without area, and all but the first of those with the same three corners.

    Returns:
        The remaining mesh, the indices of its triangles in `mesh`, and a note on dropped triangles,
        empty if there are none.

    Raises:
        ValueRangeError: no triangle is left.
    """
    edges = mesh.triangles - np.roll(mesh.triangles, 1, axis=1)
    longest = np.einsum("fei,fei->fe", edges, edges).max(axis=1)
    flat = 2.0 * mesh.face_areas <= THINNEST_TRIANGLE * longest
    firsts = np.unique(np.sort(mesh.faces, axis=1), axis=0, return_index=True)[1]
    repeated = np.ones(len(mesh.faces), np.bool_)
    repeated[firsts] = False
    repeated &= ~flat
    kept = np.flatnonzero(~flat & ~repeated)
    if not len(kept):
        raise ValueRangeError("mesh", "without area", "a surface: no triangle has three corners")
    counts = {"degenerate": int(flat.sum()), "duplicate": int(repeated.sum())}
    dropped = [counted(count, f"{kind} triangle") for kind, count in counts.items() if count]
    note = f"dropped {' and '.join(dropped)}" if dropped else ""
    return mesh.submesh(kept), kept, note


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Write `mesh` as binary ply or as obj, by the suffix of `path`; same mesh, same bytes."""
    match path.suffix.lower():
        case ".ply":
            write_bytes(path, _ply_bytes(mesh))
        case ".obj":
            write_bytes(path, _obj_text(mesh).encode("ascii"))
        case suffix:
            raise UnknownNameError("mesh format to write", suffix, (".obj", ".ply"))


def _load(path: Path) -> trimesh.Trimesh:
    with _parsing(path):
        loaded = _geometry(path)
    if not isinstance(loaded, trimesh.Trimesh):
        raise FormatError(path, "the file holds points but no triangles", "give a triangle mesh")
    if len(loaded.faces) and not 0 <= loaded.faces.min() <= loaded.faces.max() < len(
        loaded.vertices
    ):
        raise FormatError(
            path, "a triangle names a vertex that does not exist", "export the mesh again"
        )
    return loaded


@contextmanager
def _parsing(path: Path) -> Iterator[None]:
    try:
        yield
    except SymgraspError:
        raise
    except Exception as error:  # trimesh's parsers raise errors of many types
        problem = f"not readable as {path.suffix} ({type(error).__name__}: {reason(error)})"
        raise FormatError(path, problem, "export the mesh again") from error


def _geometry(path: Path) -> Any:  # noqa: ANN401 - a mesh or a cloud of trimesh
    """Return the single mesh or cloud of a file, without its materials and textures.

    Only the bytes of the file are read: given the path, trimesh would open other named files.
    """
    data = read_bytes(path, MAX_MESH_BYTES)
    kind = path.suffix.lower().removeprefix(".")
    if kind == "obj":  # trimesh would sort the triangles by their material
        data = MATERIAL_LINE.sub(b"", data)
    if kind == "off":
        _refuse_cut_off(path, data)
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False, skip_materials=True)
    shown = [scene.graph[name][1] for name in scene.graph.nodes_geometry]
    triangles = sum(len(getattr(scene.geometry[name], "faces", ())) for name in shown)
    if triangles > MAX_TRIANGLES:
        raise FormatError(
            path, f"contains {triangles} triangles", f"at most {MAX_TRIANGLES} are read"
        )
    for each in scene.geometry.values():
        shape = np.shape(each.vertices)
        if len(shape) != 2 or shape[1] != 3:
            raise FormatError(path, f"has vertices of shape {shape}", "3 numbers each are expected")
    clouds = [each for each in scene.geometry.values() if isinstance(each, trimesh.PointCloud)]
    return clouds[0] if clouds and not triangles else scene.to_mesh()


def _refuse_cut_off(path: Path, data: bytes) -> None:
    """Raise FormatError if an OFF file has fewer lines than it announces: trimesh reads those."""
    text = COMMENT.sub(b"", data).partition(b"OFF")[2]
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:  # trimesh names the fault
        return
    announced = sum(int(word) for word in lines[0].split()[:2] if word.isdigit())
    if len(lines) - 1 < announced:
        found = f"has {len(lines) - 1} of {announced} announced vertices and faces"
        raise FormatError(path, found, "copy the file again")


def _ply_bytes(mesh: Mesh) -> bytes:
    header = PLY_HEADER.format(vertices=len(mesh.vertices), faces=len(mesh.faces))
    faces = np.zeros(len(mesh.faces), dtype=[("count", "u1"), ("indices", "<i4", (3,))])
    faces["count"] = 3
    faces["indices"] = mesh.faces
    vertices = np.asarray(mesh.vertices, dtype="<f4")
    return b"".join((header.encode("ascii"), vertices.tobytes(), faces.tobytes()))


def _obj_text(mesh: Mesh) -> str:
    # Nine significant digits identify a float32, so ply and obj hold the same mesh.
    vertices = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.astype(np.float32)]
    faces = [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    return "\n".join([*vertices, *faces]) + "\n"
