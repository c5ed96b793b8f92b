"""Cut an object without global symmetry into regions that have their own (Sec. III-D).

A candidate that holds on most of the surface, such as a teapot body's axis, gives the first
region: the connected triangles that support it. What is left is cut into connected components,
or into nearly convex pieces, and each is searched for symmetries of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, KDTree, QhullError

from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.convex_decomposition import convex_pieces
from pipelines.geometry.mesh import Mesh
from pipelines.geometry.surface import Surface, diameter
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, Symmetry
from pipelines.geometry.symmetry_detection import Detection, analyse
from pipelines.geometry.symmetry_verification import VERIFICATION_ANGLES, Samples, supported

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

WHOLE = "whole"
NUM_SUPPORT_SAMPLES = 8000
NUM_CANDIDATES = 6
MIN_AREA_SHARE = 0.06  # smaller parts are left out
MIN_COMPONENT_SHARE = 0.95  # of the area in large components, or the mesh is cut by convexity
MAX_MEAN_NORMAL = 0.75  # 0 for a closed surface, 0.5 for a bowl, 1 for a flat sheet
PIECE_SAMPLES = 12000  # a piece is smaller than its object
# coacd's own settings take half a minute an object; these find the same few large pieces.
COARSE_SEARCH = {
    "threshold": 0.15,
    "max_convex_hull": 6,
    "seed": 0,
    "preprocess_resolution": 20,
    "resolution": 500,
    "mcts_nodes": 8,
    "mcts_iterations": 20,
    "mcts_max_depth": 1,
}


@dataclass(frozen=True)
class SymmetricRegion:
    """Triangles of a mesh and the symmetries they have; `triangles`: (k,) sorted indices."""

    name: str
    triangles: Faces
    symmetries: list[Symmetry]


def symmetric_regions(
    mesh: Mesh, detection: Detection, config: AnnotateSymmetryConfig, rng: np.random.Generator
) -> list[SymmetricRegion]:
    """Return the symmetric regions of `mesh`, of which `detection` was made, mesh frame.

    An object with a symmetry that the network has a slot for is one region, the whole; so is an
    object in which nothing symmetric is found, then without symmetries.
    """
    everything = np.arange(len(mesh.faces))
    whole = SymmetricRegion(WHOLE, everything, detection.symmetries)
    if has_slot(detection.symmetries):
        return [whole]
    regions = []
    rest = everything
    body = _supported_body(mesh, detection.partial, config, rng)
    if body is not None:
        regions.append(body)
        rest = np.setdiff1d(everything, body.triangles)
    for piece in _pieces(mesh, rest):
        region = _piece_region(mesh, piece, f"part{len(regions)}", config, rng)
        if region is not None:
            regions.append(region)
    return regions or [whole]


def has_slot(symmetries: list[Symmetry]) -> bool:
    """Return whether any symmetry is one the network predicts: discrete rotations are not."""
    return any(getattr(symmetry, "order", None) is None for symmetry in symmetries)


def _supported_body(
    mesh: Mesh,
    candidates: list[Symmetry],
    config: AnnotateSymmetryConfig,
    rng: np.random.Generator,
) -> SymmetricRegion | None:
    """Return the largest connected part that supports a candidate on enough of the surface."""
    surface = Surface.from_mesh(mesh, NUM_SUPPORT_SAMPLES, rng)
    size = diameter(mesh.vertices[np.unique(mesh.faces)])
    for candidate in candidates[:NUM_CANDIDATES]:
        images = _images(surface, candidate)
        held = supported(surface, images, size)
        faces = np.flatnonzero(_face_votes(mesh, surface, held))
        if mesh.face_areas[faces].sum() < config.min_region_support * mesh.area:
            continue
        body = max(components(mesh, faces), key=lambda part: float(mesh.face_areas[part].sum()))
        enough = mesh.face_areas[body].sum() >= config.min_region_support * mesh.area
        if not enough or _is_patch(mesh.submesh(body)):
            continue
        found = analyse(mesh.submesh(body), config, rng).symmetries
        return SymmetricRegion("body", body, found if has_slot(found) else [candidate])
    return None


def _images(surface: Surface, candidate: Symmetry) -> Iterator[Samples]:
    points, normals = surface.points, surface.normals
    if isinstance(candidate, ReflectionSymmetry):
        yield Samples(candidate.counterpart(points), candidate.mirror_vectors(normals))
    elif isinstance(candidate, RotationSymmetry):
        for angle in VERIFICATION_ANGLES:
            moved = candidate.turn(points, angle)
            yield Samples(moved, candidate.turn(points + normals, angle) - moved)


def _face_votes(mesh: Mesh, surface: Surface, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which triangles (f,) hold: the majority of their samples, else the nearest one."""
    count = np.bincount(surface.faces, minlength=len(mesh.faces))
    votes = np.bincount(surface.faces, weights=held, minlength=len(mesh.faces))
    nearest = surface.nearest(mesh.triangles.mean(axis=1))
    return np.where(count > 0, votes > 0.5 * count, held[nearest])


def components(mesh: Mesh, faces: Faces) -> list[Faces]:
    """Return the connected parts of `faces`: triangles that share an edge, as index arrays."""
    edges = np.sort(mesh.faces[faces][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    number = np.unique(edges, axis=0, return_inverse=True)[1].reshape(-1)
    owner = np.repeat(np.arange(len(faces)), 3)
    # Triangles and edges are the two sides of one graph.
    size = len(faces) + int(number.max(initial=-1)) + 1
    graph = coo_matrix((np.ones(len(owner)), (owner, len(faces) + number)), shape=(size, size))
    label = connected_components(graph, directed=False)[1][: len(faces)]
    return [faces[label == part] for part in np.unique(label)]


def _pieces(mesh: Mesh, faces: Faces) -> list[Faces]:
    """Return the parts of `faces` to search, largest first; parts too small are left out."""
    if not len(faces):
        return []
    large = [part for part in components(mesh, faces) if _share(mesh, part) >= MIN_AREA_SHARE]
    covered = sum(_share(mesh, part) for part in large)
    if len(large) < 2 or covered < MIN_COMPONENT_SHARE * _share(mesh, faces):
        large = _convex_pieces(mesh, faces)
    large = [part for part in large if _share(mesh, part) >= MIN_AREA_SHARE]
    return sorted(large, key=lambda part: -_share(mesh, part))


def _share(mesh: Mesh, faces: Faces) -> float:
    return float(mesh.face_areas[faces].sum() / mesh.area)


def _convex_pieces(mesh: Mesh, faces: Faces) -> list[Faces]:
    """Cut `faces` by the nearly convex pieces of their mesh: each goes to the nearest piece."""
    used, index = np.unique(mesh.faces[faces], return_inverse=True)
    part = Mesh(mesh.vertices[used], index.reshape(-1, 3))
    hulls = convex_pieces(part, COARSE_SEARCH)
    if not hulls:
        return components(mesh, faces)
    centers = mesh.triangles[faces].mean(axis=1)
    depth = np.stack([_outside(corners, centers) for corners in hulls])
    owner = depth.argmin(axis=0)
    return [
        max(components(mesh, faces[owner == hull]), key=len)
        for hull in range(len(hulls))
        if (owner == hull).any()
    ]


def _outside(corners: Array, points: Array) -> Array:
    """Return how far `points` (n, 3) lie outside the hull of `corners`; negative inside."""
    try:
        equations = ConvexHull(corners, qhull_options="QJ").equations
    except QhullError:
        return np.asarray(KDTree(corners).query(points)[0])
    return np.asarray((points @ equations[:, :3].T + equations[:, 3]).max(axis=1))


def _is_patch(part: Mesh) -> bool:
    """Return whether all of `part` looks to one side: fingers cannot close on it."""
    mean = part.face_areas @ part.face_normals / part.area
    return float(np.linalg.norm(mean)) > MAX_MEAN_NORMAL


def _piece_region(
    mesh: Mesh, piece: Faces, name: str, config: AnnotateSymmetryConfig, rng: np.random.Generator
) -> SymmetricRegion | None:
    part = mesh.submesh(piece)
    if diameter(part.vertices[np.unique(part.faces)]) < config.min_region_extent or _is_patch(part):
        return None
    coarser = replace(config, num_samples=min(PIECE_SAMPLES, config.num_samples))
    found = analyse(part, coarser, rng).symmetries
    return SymmetricRegion(name, piece, found) if has_slot(found) else None
