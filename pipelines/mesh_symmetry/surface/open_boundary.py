"""Rims of open surfaces, where a scan ends or a hole begins.

The surface beyond a rim is unknown, so images beyond a rim do not count against a symmetry. Not
every edge of a single triangle is a rim: unwelded vertices, T-junctions and doubled faces make such
edges on closed surfaces. These are seams: the edge of another sheet runs along each.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import unit

WELD = 1e-5  # of the bounding box's diagonal; nearer corners are the same
SPACING = 0.004  # of the diagonal, between points of a rim
SEAM = 0.003  # of the diagonal; nearer edges of two sheets are a seam
OPPOSITE_COSINE = 0.5  # two sheets of a seam continue in directions farther apart than this
# The edges of a seam are parallel; the edges of a jagged rim, however small, zigzag.
ALONGSIDE_COSINE = 0.8
MIN_SEAM_SHARE = 0.5  # of an edge's points
MAX_RIM_POINTS = 60000
NUM_LINKS = 8  # neighbours of a sample
MIN_RIM_SHARE = 0.5  # least share of rim on the border of a patch in a hole
MIN_ENCLOSED = 0.8  # same share for a patch inside others, whose samples count as rim
NUM_NEAREST = 6


@dataclass(frozen=True)
class OpenBoundary:
    """Points (k, 3) along the rims of a surface, and unit directions (k, 3) out of the surface.

    The directions lie in the surface, across the rim. Unit and frame of the mesh.
    """

    points: Array
    outward: Array

    @cached_property
    def tree(self) -> KDTree | None:
        """The tree of the points; None without points."""
        return KDTree(self.points) if len(self.points) else None

    @classmethod
    def of(cls, mesh: Mesh) -> "OpenBoundary":
        """Find the rims of `mesh`; a closed surface has none, in any tessellation."""
        size = mesh.diagonal
        corners, opposite = _single_edges(mesh, WELD * size)
        points, outward, owner = _sampled(corners, opposite, SPACING * size)
        along = unit(corners[:, 1] - corners[:, 0])[owner]
        seam = _is_seam(points, outward, along, owner, SEAM * size)
        # A rim is near itself at its corners only, a seam along its whole length.
        share = np.bincount(owner, weights=seam) / np.maximum(np.bincount(owner), 1)
        keep = share[owner] < MIN_SEAM_SHARE
        return cls(points[keep], outward[keep])

    def moved(self, center: Array, size: float) -> "OpenBoundary":
        """Return the boundary moved by -`center` (3,) and divided by `size`."""
        return OpenBoundary((self.points - center) / size, self.outward)

    def distances(self, points: Array, reach: float) -> Array:
        """Return the distances (n,) of `points` (n, 3) to the nearest rim, inf beyond `reach`."""
        if self.tree is None:
            return np.full(len(points), np.inf)
        return np.asarray(self.tree.query(points, distance_upper_bound=reach)[0])


def linked(points: Array) -> Indices:
    """Return the pairs (e, 2) of neighbours among surface samples `points` (n, 3)."""
    count = len(points)
    index = KDTree(points).query(points, k=min(NUM_LINKS + 1, count))[1].reshape(count, -1)
    first = np.repeat(np.arange(count), index.shape[1] - 1)
    return np.column_stack([first, index[:, 1:].ravel()])


def cut_off(missed: Mask, at_rim: Mask, rim_is_nearest: Mask, links: Indices) -> Mask:
    """Return the mask (n,) of samples whose image is beyond a rim of the surface.

    `missed`: (n,) samples whose image is off the surface, `at_rim`: (n,) samples whose image is
    near a rim, `rim_is_nearest`: (n,) samples whose image has no part of the surface much nearer
    than the rim, `links`: (e, 2) pairs of neighbouring samples. Linked samples of `missed` form
    patches, separately with and without a nearest rim, as a hole may be next to a dent. A patch
    with a rim along its border is in a hole, and so is a patch inside such a patch; without a rim,
    the surface continues in another shape, such as a handle.
    """
    alike = rim_is_nearest[links[:, 0]] == rim_is_nearest[links[:, 1]]
    inside = links[missed[links].all(axis=1) & alike]
    count = len(missed)
    graph = coo_matrix((np.ones(len(inside)), (inside[:, 0], inside[:, 1])), (count, count))
    patch = connected_components(graph, directed=False)[1]
    border = links[missed[links[:, 0]] & (patch[links[:, 0]] != patch[links[:, 1]])]
    beyond = np.zeros(count, dtype=bool)
    outer = border[~missed[border[:, 1]]]
    for counted, least in ((outer, MIN_RIM_SHARE), (border, MIN_ENCLOSED)):
        total = np.bincount(patch[counted[:, 0]], minlength=count)
        ends = beyond | (at_rim & ~missed)
        ended = np.bincount(patch[counted[:, 0]], weights=ends[counted[:, 1]], minlength=count)
        beyond |= missed & ((total > 0) & (ended >= least * total))[patch]
    return beyond


def _single_edges(mesh: Mesh, tolerance: float) -> tuple[Array, Array]:
    """Return the edges (e, 2, 3) of single triangles, and the opposite corners (e, 3)."""
    cells = np.round((mesh.vertices - mesh.bounds[0]) / tolerance).astype(np.int64)
    label = _unique_rows(cells)
    faces = label[mesh.faces]
    ordered = np.sort(faces, axis=1)
    real = (ordered[:, 0] != ordered[:, 1]) & (ordered[:, 1] != ordered[:, 2])
    chosen = np.flatnonzero(real)
    # Duplicate faces, flipped or not, count once.
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
    for column in rows.T[1:]:  # column by column, so that products fit into 64 bits
        key = np.unique(key, return_inverse=True)[1] * (int(column.max(initial=0)) + 1) + column
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64)


def _sampled(edges: Array, opposite: Array, spacing: float) -> tuple[Array, Array, Indices]:
    """Return points along `edges`, directions away from their triangles, and their edges."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    length = np.linalg.norm(along, axis=1)
    direction = unit(along)
    inward = opposite - start
    inward -= np.einsum("ed,ed->e", inward, direction)[:, None] * direction
    spacing = max(spacing, float(length.sum()) / MAX_RIM_POINTS)
    count = np.maximum(np.ceil(length / spacing), 1.0).astype(np.int64)
    owner = np.repeat(np.arange(len(edges)), count)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    share = (place + 0.5) / count[owner]
    return start[owner] + share[:, None] * along[owner], -unit(inward)[owner], owner


def _is_seam(points: Array, outward: Array, along: Array, owner: Indices, reach: float) -> Mask:
    """Return the mask of points of single edges with the edge of another sheet along them."""
    if len(points) <= 1:
        return np.zeros(len(points), dtype=bool)
    k = min(NUM_NEAREST, len(points))
    index = KDTree(points).query(points, k=k, distance_upper_bound=reach)[1]
    found = np.asarray(index).reshape(len(points), k)
    missing = found == len(points)
    found = np.where(missing, 0, found)
    cosine = np.einsum("nkd,nd->nk", outward[found], outward)
    parallel = np.abs(np.einsum("nkd,nd->nk", along[found], along)) > ALONGSIDE_COSINE
    other = (owner[found] != owner[:, None]) & (cosine < OPPOSITE_COSINE) & parallel & ~missing
    return np.asarray(other.any(axis=1))
