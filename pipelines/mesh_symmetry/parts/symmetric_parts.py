"""Segmentation of an object into symmetric regions (Sec. III-D; D. 36).

A sphere or a body of revolution stays whole. Other objects are searched for bodies of revolution: a
body with enough lateral surface, such as a mug's wall, becomes a region, and so does every
graspable part left over. An object with mirror planes and no such body, such as a box, stays whole.
An object without symmetry is cut further: by the mirror plane that explains most of it, and into
nearly convex pieces.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, KDTree, QhullError

from pipelines.array_types import Array, Indices, Mask
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.geometry.meshes.convex_decomposition import decomposed
from pipelines.geometry.meshes.diameter import diameter
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ObjectRegion, Symmetry
from pipelines.mesh_symmetry.detection.symmetry_detection import MeshSymmetries
from pipelines.mesh_symmetry.parts.part_symmetries import PartSymmetries, is_round
from pipelines.mesh_symmetry.parts.revolved_bodies import MAX_SMOOTH_BORDER, revolved_bodies
from pipelines.mesh_symmetry.parts.sampled_parts import NO_PART, SampledParts

WHOLE_REGION = "whole"
NUM_SAMPLES = 8000  # of the object, for cutting
MAX_MEAN_NORMAL = 0.6  # length: 0 for a closed surface, 0.5 for a bowl, 1 for an ungraspable sheet
SMALL_OBJECT = 0.5  # of its object's diameter; a larger part counts as graspable
MAX_LOOSE_SHARE = 0.2  # largest ungraspable share outside of bodies: a mug, but not a peach
MIN_DETAIL = 0.1  # least share of a symmetric part that is cut out of an object without symmetry
FACES_AT_A_TIME = 2000  # of a hull; a scan's hull has more than 100,000
MIN_CUT_SHARE = 0.2  # smaller parts are not cut into convex pieces

# coacd's defaults take half a minute per object; these settings find the same large pieces.
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
class _Piece:
    """A part of an object: its samples and its symmetries."""

    members: Mask  # (m,) samples
    symmetries: list[Symmetry]
    is_body: bool = False


def symmetric_regions(
    mesh: Mesh, detection: MeshSymmetries, config: AnnotateSymmetryConfig, rng: np.random.Generator
) -> list[ObjectRegion]:
    """Return the symmetric regions of `mesh`, mesh frame, given the `detection` of the whole.

    No triangle is in two regions. An object without any symmetric part is one region, the whole,
    without symmetries.
    """
    whole = ObjectRegion(WHOLE_REGION, np.arange(len(mesh.faces)), tuple(detection.symmetries))
    if any(is_round(symmetry) for symmetry in detection.symmetries):
        return [whole]
    parts = SampledParts.of(mesh, NUM_SAMPLES, rng)
    search = PartSymmetries(parts, detection, config, rng, diameter(parts.surface.points))
    mirrored = has_slot(detection.symmetries)
    pieces = _mirrored_pieces(search) if mirrored else _asymmetric_pieces(search)
    symmetric = sum(piece.members.mean() for piece in pieces if has_slot(piece.symmetries))
    if symmetric < MIN_DETAIL:
        return [whole]
    return _regions(parts, pieces)


def has_slot(symmetries: Sequence[Symmetry]) -> bool:
    """Return whether `symmetries` has a kind that the network predicts: no discrete rotation."""
    return any(getattr(symmetry, "order", None) is None for symmetry in symmetries)


def _mirrored_pieces(search: PartSymmetries) -> list[_Piece]:
    """Return bodies of revolution and the other parts; none if the object stays whole."""
    everything = np.ones(NUM_SAMPLES, dtype=np.bool_)
    pieces = _bodies(search, everything, search.config.min_body_share)
    # A body equal to the whole object would contradict the detection, as for many-sided columns.
    if not pieces or pieces[0].members.all():
        return []
    loose: list[Mask] = []
    for members in search.parts.clusters(_left(pieces, everything)):
        if _is_graspable(search, members):
            pieces.append(_Piece(members, search.part(members)))
        else:
            loose.append(members)
    if sum(members.mean() for members in loose) > MAX_LOOSE_SHARE:
        return []
    return _joined(search, pieces, loose)


def _asymmetric_pieces(search: PartSymmetries) -> list[_Piece]:
    """Return the symmetric parts of an object without symmetry, and the remaining part."""
    everything = np.ones(NUM_SAMPLES, dtype=np.bool_)
    pieces = _bodies(search, everything, search.config.min_body_share)
    mirrored = search.largest_mirrored(_left(pieces, everything))
    if mirrored is not None and _is_graspable(search, mirrored):
        pieces.append(_Piece(mirrored, search.part(mirrored)))
    loose: list[Mask] = []
    for members in search.parts.clusters(_left(pieces, everything)):
        found = _cut_further(search, members)
        pieces += found
        for left in search.parts.clusters(_left(found, members)):
            if _is_graspable(search, left):
                pieces.append(_Piece(left, []))
            else:
                loose.append(left)
    return _joined(search, pieces, loose)


def _bodies(search: PartSymmetries, among: Mask, min_lateral: float) -> list[_Piece]:
    pieces = [
        _Piece(body.members, search.body(body), is_body=True)
        for body in revolved_bodies(search.parts, among, min_lateral)
        if _is_graspable(search, body.members)
    ]
    return [piece for piece in pieces if piece.symmetries]


def _cut_further(search: PartSymmetries, members: Mask) -> list[_Piece]:
    """Return the symmetric pieces of `members`: the whole, its bodies, or nearly convex parts."""
    if not _is_graspable(search, members):
        return []
    found = search.part(members)
    if has_slot(found):
        return [_Piece(members, found)]
    pieces = _bodies(search, members, MIN_DETAIL)
    for rest in search.parts.clusters(_left(pieces, members)):
        if rest.mean() >= MIN_CUT_SHARE:
            pieces += _convex_pieces(search, rest)
    return pieces


def _convex_pieces(search: PartSymmetries, members: Mask) -> list[_Piece]:
    """Return the symmetric parts among the nearly convex parts of `members`."""
    pieces = []
    owner = np.full(NUM_SAMPLES, NO_PART, dtype=np.int64)
    mesh = search.parts.submesh(members)
    owner[members] = _convex_owner(mesh, search.parts.surface.points[members])
    for index in np.unique(owner[members]):
        piece = search.parts.clusters(owner == index)[0]
        seen = search.parts.smooth_border(piece) <= MAX_SMOOTH_BORDER
        # A region consists of triangles; if they are large, a piece may get very few.
        represented = search.parts.on_triangles(piece)
        if not seen or not all(_is_graspable(search, part) for part in (piece, represented)):
            continue
        found = search.part(piece)
        if has_slot(found):
            pieces.append(_Piece(piece, found))
    return pieces


def _convex_owner(mesh: Mesh, points: Array) -> Indices:
    """Return the index (n,) of the nearly convex piece of `mesh` around each of `points` (n, 3).

    All 0 if coacd finds no pieces.
    """
    used, index = np.unique(mesh.faces, return_inverse=True)
    hulls = decomposed(Mesh(mesh.vertices[used], index.reshape(-1, 3)), COARSE_SEARCH)
    if not hulls:
        return np.zeros(len(points), dtype=np.int64)
    depth = np.stack([_outside(corners, points) for corners in hulls])
    return np.asarray(depth.argmin(axis=0))


def _outside(corners: Array, points: Array) -> Array:
    """Return the distance (n,) of `points` (n, 3) from the hull of `corners`; negative inside."""
    try:
        equations = ConvexHull(corners, qhull_options="QJ").equations
    except QhullError:
        return np.asarray(KDTree(corners).query(points)[0])
    depth = np.full(len(points), -np.inf)
    for start in range(0, len(equations), FACES_AT_A_TIME):
        some = equations[start : start + FACES_AT_A_TIME]
        np.maximum(depth, (points @ some[:, :3].T + some[:, 3]).max(axis=1), out=depth)
    return depth


def _is_graspable(search: PartSymmetries, members: Mask) -> bool:
    """Return whether a part is large enough, and no sheet that fingers cannot close across."""
    surface, config = search.parts.surface, search.config
    if members.mean() < config.min_part_share or members.sum() < 5:
        return False
    extent = diameter(surface.points[members])
    if extent < min(config.min_region_extent, SMALL_OBJECT * search.size):
        return False
    return float(np.linalg.norm(surface.normals[members].mean(axis=0))) <= MAX_MEAN_NORMAL


def _left(pieces: list[_Piece], members: Mask) -> Mask:
    return np.asarray(members & ~np.any([piece.members for piece in pieces], axis=0))


def _joined(search: PartSymmetries, pieces: list[_Piece], loose: list[Mask]) -> list[_Piece]:
    """Return `pieces`, with each of `loose` joined to the piece of most contact if planes hold."""
    scraps: list[list[Mask]] = [[] for _ in pieces]
    for scrap in loose:
        links = [search.parts.touching(scrap, piece.members) for piece in pieces]
        if max(links, default=0.0) > 0.0:
            scraps[int(np.argmax(links))].append(scrap)
    return [_with_scraps(search, *both) for both in zip(pieces, scraps, strict=True)]


def _with_scraps(search: PartSymmetries, piece: _Piece, scraps: list[Mask]) -> _Piece:
    """Return `piece` with `scraps`, smallest first, as long as the planes of `piece` hold."""
    left = sorted(scraps, key=np.count_nonzero)
    while left:
        members = np.any([piece.members, *left], axis=0)
        if piece.is_body:  # other parts may touch a body; its axis holds anyway
            return replace(piece, members=members)
        symmetries = search.still_held(piece.symmetries, members)
        if symmetries is not None:
            return replace(piece, members=members, symmetries=symmetries)
        left.pop()
    return piece


def _regions(parts: SampledParts, pieces: list[_Piece]) -> list[ObjectRegion]:
    owner = np.full(NUM_SAMPLES, NO_PART, dtype=np.int64)
    for index, piece in enumerate(pieces):
        owner[piece.members] = index
    of_faces = parts.owner_of_faces(owner)
    regions: list[ObjectRegion] = []
    for index, piece in enumerate(pieces):
        triangles = np.flatnonzero(of_faces == index)
        kind = "body" if piece.is_body else "part"
        number = sum(region.name.startswith(kind) for region in regions)
        if len(triangles):
            regions.append(ObjectRegion(f"{kind}{number}", triangles, tuple(piece.symmetries)))
    return regions
