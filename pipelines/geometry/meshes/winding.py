"""Winding of a mesh's triangles: made consistent and turned outward, on open meshes too.

Meshes from scans and drawing programs have triangles that face inward, all of them or some. On a
closed mesh the sign of the volume would decide. Here rays leave both sides of each sheet: the side
from which far fewer rays escape is the inside.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.rendering import first_hits
from pipelines.geometry.transforms import unit

NUM_SAMPLES = 2000  # points of the whole surface that rays leave from
SAMPLES_A_SHEET = 8  # at least, on each sheet
NUM_DIRECTIONS = 12  # rays from a point, on each side
LIFT = 1e-5  # of the bounding box's diagonal: distance of a ray's start from its triangle
CLEARLY_LESS = 0.5  # escaping rays of the inside, at most, relative to the outside
NOTABLE = 0.01  # share of a surface
SEEN_AT_ALL = 0.02  # share of escaping rays; below, a sheet is in a closed hollow


def looks_inward(mesh: Mesh) -> Mask:
    """Return a mask (f,) of the triangles of `mesh` that face inward, or against their sheet.

    Triangles that share an edge with one other triangle form a sheet. If equally many rays escape
    from both sides, as from a leaf of paper, or no rays, as from the wall of a closed hollow, the
    sheet is turned as most other sheets are.
    """
    pairs, opposed = _neighbors(mesh.faces)
    against, sheet = _against_first(len(mesh.faces), pairs, opposed)
    if mesh.is_watertight and not against.any():
        a, b, c = mesh.triangles.swapaxes(0, 1)
        volumes = np.bincount(sheet, np.einsum("ij,ij->i", a, np.cross(b, c)))
        if (volumes > 0.0).all():
            return against  # no rays are needed
    # The majority of a sheet's area decides, unless rays decide otherwise.
    signed = np.bincount(sheet, np.where(against, -1.0, 1.0) * mesh.face_areas)
    against ^= signed[sheet] < 0.0
    inward, outward = _clear_sides(_turned(mesh, against), sheet)
    areas = np.bincount(sheet, mesh.face_areas)
    if areas[inward].sum() > areas[outward].sum():
        inward = ~outward
    return np.asarray(against ^ inward[sheet])


def turned_outward(mesh: Mesh) -> tuple[Mesh, str]:
    """Return `mesh` with all triangles facing outward, in the same order, and a note on the change.

    The mesh is unchanged and the note empty if less than a notable share faces inward: scans have
    some folded triangles.
    """
    inward = looks_inward(mesh)
    if mesh.face_areas[inward].sum() <= NOTABLE * mesh.area:
        return mesh, ""
    which = "its" if inward.all() else f"{inward.sum()} of its {len(inward)}"
    return _turned(mesh, inward), f"turned {which} triangles, which looked inward"


def _turned(mesh: Mesh, which: Mask) -> Mesh:
    return replace(mesh, faces=np.where(which[:, None], mesh.faces[:, ::-1], mesh.faces))


def _neighbors(faces: Indices) -> tuple[Indices, Mask]:
    """Return the pairs (e, 2) of triangles that share an edge, and a mask (e,) of opposed pairs."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    rising = edges[:, 0] < edges[:, 1]
    key = edges.min(axis=1) * (faces.max() + 1) + edges.max(axis=1)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    twice = starts[np.diff(starts, append=len(order)) == 2]
    first, second = order[twice], order[twice + 1]
    pairs = np.column_stack([first, second]) // 3
    # Both triangles run along the edge in one direction, so they face different sides.
    opposed = rising[first] == rising[second]
    # Folded triangles share two edges.
    _, kept = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True)
    return pairs[kept], opposed[kept]


def _against_first(count: int, pairs: Indices, opposed: Mask) -> tuple[Mask, Indices]:
    """Return which of `count` triangles are opposed to the first of their sheet, and the sheets."""
    # Sparse graphs hold no zeros, so each entry is the weight plus one.
    graph = coo_matrix((1 + opposed, (pairs[:, 0], pairs[:, 1])), (count + 1, count + 1))
    sheet = connected_components(graph, directed=False)[1][:count].astype(np.int64)
    firsts = np.unique(sheet, return_index=True)[1]
    # A root above the first triangles of all sheets joins the sheets into one tree.
    rooted = graph + coo_matrix(
        (np.ones(len(firsts), np.int64), (np.full(len(firsts), count), firsts)), graph.shape
    )
    rooted = (rooted + rooted.T).tocsr()
    _, before = breadth_first_order(rooted, count, directed=False)
    before = before.astype(np.int64)
    before[count] = count
    against = np.zeros(count + 1, np.bool_)
    each = np.arange(count)
    against[:count] = np.asarray(rooted[each, before[:count]]).ravel() == 2
    while (before != count).any():  # twice as far up the tree each time
        against ^= against[before]
        before = before[before]
    return against[:count], sheet


def _clear_sides(mesh: Mesh, sheet: Indices) -> tuple[Mask, Mask]:
    """Return masks of the sheets that clearly face inward and outward, by escaping rays."""
    rng = np.random.default_rng(0)
    points, normals, triangle = _samples(mesh, sheet, rng)
    directions = unit(rng.normal(size=(len(points), NUM_DIRECTIONS, 3)))
    side = np.einsum("nkj,nj->nk", directions, normals)
    directions *= np.sign(side)[..., None]
    lift = LIFT * mesh.diagonal
    away = [
        np.isinf(_distances(mesh, points + sign * lift * normals, sign * directions)).mean(axis=1)
        for sign in (1.0, -1.0)
    ]
    before, behind = (np.bincount(sheet[triangle], seen, sheet.max() + 1) for seen in away)
    num = np.maximum(np.bincount(sheet[triangle], minlength=sheet.max() + 1), 1)
    inward = (before < CLEARLY_LESS * behind) & (behind > SEEN_AT_ALL * num)
    outward = (behind < CLEARLY_LESS * before) & (before > SEEN_AT_ALL * num)
    return np.asarray(inward), np.asarray(outward)


def _samples(mesh: Mesh, sheet: Indices, rng: np.random.Generator) -> tuple[Array, Array, Indices]:
    """Return points (n, 3), normals (n, 3) and triangles (n,), by area, some on each sheet."""
    points, normals, triangle = sample_surface(mesh, NUM_SAMPLES, rng)
    order = rng.permutation(len(sheet))
    order = order[np.argsort(sheet[order], kind="stable")]
    starts = np.flatnonzero(np.diff(sheet[order], prepend=-1))
    place = np.arange(len(order)) - np.repeat(starts, np.diff(starts, append=len(order)))
    some = order[place < SAMPLES_A_SHEET]
    centers = mesh.triangles[some].mean(axis=1)
    return (
        np.concatenate([points, centers]),
        np.concatenate([normals, mesh.face_normals[some]]),
        np.concatenate([triangle, some]),
    )


def _distances(mesh: Mesh, origins: Array, directions: Array) -> Array:
    """Return the free length (n, k) of rays from `origins` (n, 3) along `directions` (n, k, 3)."""
    starts = np.broadcast_to(origins[:, None], directions.shape)
    distance, _ = first_hits(mesh, starts.reshape(-1, 3), directions.reshape(-1, 3))
    return distance.reshape(directions.shape[:2])
