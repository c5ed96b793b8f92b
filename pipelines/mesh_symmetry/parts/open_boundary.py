"""The rim of a surface that is not closed: where a scan ends, or a hole begins.

What lies beyond a rim is unknown, so a symmetry must not be blamed for images that land there. An
edge of one triangle alone is not yet a rim: unwelded vertices, T-junctions and doubled faces make
such edges on closed surfaces. They are told apart by what runs along them: a seam has the edge of
another sheet at the same place, a rim has nothing.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import unit

WELD = 1e-5  # of the bounding box's diagonal: nearer corners are one
SPACING = 0.004  # of the diagonal, between the points that stand for a rim
SEAM = 0.003  # of the diagonal: nearer edges of two sheets are a seam
OPPOSITE_COSINE = 0.5  # sheets that meet at a seam do not leave it in the same direction
MIN_SEAM_SHARE = 0.5  # of an edge's points
MAX_POINTS = 60000
NUM_LINKS = 8  # neighbours of a sample
MIN_RIM_SHARE = 0.5  # of the border of a patch that landed in a hole
NUM_NEAREST = 6


@dataclass(frozen=True)
class OpenBoundary:
    """Points (k, 3) along the rims of a surface and the unit directions (k, 3) that leave it.

    The directions lie in the surface, across the rim. Unit and frame of the mesh.
    """

    points: Array
    outward: Array
    tree: KDTree | None

    @classmethod
    def of(cls, mesh: Mesh) -> "OpenBoundary":
        """Find the rims of `mesh`; none on a closed surface, however it is tessellated."""
        size = mesh.diagonal
        corners, opposite = _single_edges(mesh, WELD * size)
        points, outward, owner = _sampled(corners, opposite, SPACING * size)
        seam = _is_seam(points, outward, owner, SEAM * size)
        # A jagged rim comes near itself at its corners, a seam all along.
        share = np.bincount(owner, weights=seam) / np.maximum(np.bincount(owner), 1)
        keep = share[owner] < MIN_SEAM_SHARE
        return cls.at(points[keep], outward[keep])

    @classmethod
    def at(cls, points: Array, outward: Array) -> "OpenBoundary":
        """Return the boundary of these `points` (k, 3) and directions (k, 3), k may be 0."""
        return cls(points, outward, KDTree(points) if len(points) else None)

    def moved(self, center: Array, size: float) -> "OpenBoundary":
        """Return the boundary moved by -`center` (3,) and divided by `size`."""
        return self.at((self.points - center) / size, self.outward)

    def near(self, points: Array, reach: float) -> Mask:
        """Return which of `points` (n, 3) lie within `reach` of a rim."""
        if self.tree is None:
            return np.zeros(len(points), dtype=bool)
        return np.isfinite(self.tree.query(points, distance_upper_bound=reach)[0])


def linked(points: Array) -> Indices:
    """Return the pairs (e, 2) of neighbours among surface samples `points` (n, 3)."""
    count = len(points)
    index = KDTree(points).query(points, k=min(NUM_LINKS + 1, count))[1].reshape(count, -1)
    first = np.repeat(np.arange(count), index.shape[1] - 1)
    return np.column_stack([first, index[:, 1:].ravel()])


def cut_off(missed: Mask, at_rim: Mask, links: Indices) -> Mask:
    """Return which samples (n,) miss because the other surface ended before them.

    `missed`: samples whose image is off the surface, `at_rim`: those whose image is near a rim,
    `links`: pairs (e, 2) of neighbouring samples. Neighbours that miss make a patch. Where a
    patch meets samples that do not miss, either the surface has a rim, then the patch has landed
    in a hole; or it has none, then the surface goes on differently: a handle.
    """
    inside = links[missed[links].all(axis=1)]
    count = len(missed)
    graph = coo_matrix((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), (count, count))
    patch = connected_components(graph, directed=False)[1]
    border = links[missed[links[:, 0]] & ~missed[links[:, 1]]]
    total = np.bincount(patch[border[:, 0]], minlength=count)
    ended = np.bincount(patch[border[:, 0]], weights=at_rim[border[:, 1]], minlength=count)
    return missed & ((total > 0) & (ended >= MIN_RIM_SHARE * total))[patch]


def _single_edges(mesh: Mesh, tolerance: float) -> tuple[Array, Array]:
    """Return the edges (e, 2, 3) of one triangle alone and its third corners (e, 3)."""
    cells = np.round((mesh.vertices - mesh.bounds[0]) / tolerance).astype(np.int64)
    label = _unique_rows(cells)
    faces = label[mesh.faces]
    ordered = np.sort(faces, axis=1)
    real = (ordered[:, 0] != ordered[:, 1]) & (ordered[:, 1] != ordered[:, 2])
    chosen = np.flatnonzero(real)
    # Of faces on the same corners, doubled or flipped, one is enough.
    chosen = chosen[np.unique(_unique_rows(ordered[chosen]), return_index=True)[1]]
    edges = np.sort(faces[chosen][:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    number, count = np.unique(_unique_rows(edges), return_inverse=True, return_counts=True)[1:]
    single = np.flatnonzero(count[number] == 1)
    owner, side = chosen[single // 3], single % 3
    first, second, third = ((side + k) % 3 for k in range(3))
    triangles = mesh.triangles[owner]
    rows = np.arange(len(owner))
    pair = np.stack([triangles[rows, first], triangles[rows, second]], axis=1)
    return pair, triangles[rows, third]


def _unique_rows(rows: Indices) -> Indices:
    """Return a number for each row of integers (n, k), equal for equal rows."""
    key = rows[:, 0]
    for column in rows.T[1:]:  # pair by pair, so that the products stay within 64 bits
        key = np.unique(key, return_inverse=True)[1] * (int(column.max(initial=0)) + 1) + column
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64)


def _sampled(edges: Array, opposite: Array, spacing: float) -> tuple[Array, Array, Indices]:
    """Return points along `edges`, the directions away from their triangles, and the edges."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    length = np.linalg.norm(along, axis=1)
    direction = unit(along)
    inward = opposite - start
    inward -= np.einsum("ed,ed->e", inward, direction)[:, None] * direction
    spacing = max(spacing, float(length.sum()) / MAX_POINTS)
    count = np.maximum(np.ceil(length / spacing), 1.0).astype(np.int64)
    owner = np.repeat(np.arange(len(edges)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    share = (place + 0.5) / count[owner]
    return start[owner] + share[:, None] * along[owner], -unit(inward)[owner], owner


def _is_seam(points: Array, outward: Array, owner: Indices, reach: float) -> Mask:
    """Return which points of single edges have another sheet's edge at the same place."""
    if len(points) <= 1:
        return np.zeros(len(points), dtype=bool)
    k = min(NUM_NEAREST, len(points))
    index = KDTree(points).query(points, k=k, distance_upper_bound=reach)[1]
    found = np.asarray(index).reshape(len(points), k)
    missing = found == len(points)
    found = np.where(missing, 0, found)
    cosine = np.einsum("nkd,nd->nk", outward[found], outward)
    other = (owner[found] != owner[:, None]) & (cosine < OPPOSITE_COSINE) & ~missing
    return np.asarray(other.any(axis=1))
