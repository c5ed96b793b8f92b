"""Signed-distance grids of meshes (dex-net's recipe: 100 nodes, 5 of margin on each side).

Distances are exact within NARROW_BAND nodes of the surface. Farther away a node takes the closest
surface point of the band's nearest node: never too short, too long by a spacing at most.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.meshes.line_crossings import line_crossings
from pipelines.geometry.meshes.mesh import Mesh

NODES = 100  # along each edge of the grid
MARGIN = 5  # nodes free on each side of the mesh's longest extent
NARROW_BAND = 2.5  # spacings
PAIRS_AT_A_TIME = 400_000  # (triangle, node) pairs held in memory
OFF_GRID = 1.234e-5  # spacings a column is moved aside, so that rays miss edges and vertices


@dataclass(frozen=True)
class SignedDistanceGrid:
    """A signed-distance grid: metres, object frame, negative inside."""

    values: Array  # (nx, ny, nz)
    origin: Array  # (3,) of node (0, 0, 0)
    spacing: float


def signed_distance_grid(mesh: Mesh, nodes: int = NODES) -> SignedDistanceGrid:
    """Return the signed distance to `mesh` on a cubic grid; negative inside, metres."""
    low, high = mesh.bounds
    spacing = float((high - low).max()) / (nodes - 2 * MARGIN)
    origin = (low + high) / 2.0 - nodes * spacing / 2.0
    foot = _feet_in_band(mesh, origin, spacing, nodes)
    unknown = np.isnan(foot[..., 0])
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    foot = foot[tuple(nearest)]
    place = origin + spacing * np.moveaxis(np.indices((nodes,) * 3), 0, -1)
    distance = np.linalg.norm(place - foot, axis=-1)
    inside = _inside(mesh, origin, spacing, nodes)
    return SignedDistanceGrid(np.where(inside, -distance, distance), origin, spacing)


def _feet_in_band(mesh: Mesh, origin: Array, spacing: float, nodes: int) -> Array:
    """Return (nodes, nodes, nodes, 3) the surface point closest to each node; nan off the band."""
    best = np.full(nodes**3, np.inf)
    foot = np.full((nodes**3, 3), np.nan)
    corners = (mesh.triangles - origin) / spacing  # in spacings, so that node i lies at i
    for triangles, places in node_pairs(corners, nodes, NARROW_BAND):
        above = np.einsum("ni,ni->n", places - corners[triangles, 0], mesh.face_normals[triangles])
        near = np.abs(above) <= NARROW_BAND  # of the plane: a cheap way to drop half of the pairs
        triangle, node = triangles[near], places[near]
        close = closest_points(corners[triangle], node.astype(np.float64))
        gap = np.linalg.norm(node - close, axis=1)
        flat = np.ravel_multi_index((node[:, 0], node[:, 1], node[:, 2]), (nodes,) * 3)
        kept = np.flatnonzero((gap <= NARROW_BAND) & (gap < best[flat]))
        # Of several triangles near one node the closest is written last.
        kept = kept[np.argsort(-gap[kept], kind="stable")]
        best[flat[kept]], foot[flat[kept]] = gap[kept], close[kept]
    return (foot * spacing + origin).reshape(nodes, nodes, nodes, 3)


def node_pairs(corners: Array, nodes: int, band: float) -> Iterator[tuple[Indices, Indices]]:
    """Yield triangle (m,) and node (m, 3) of all pairs that may be within `band`, in chunks.

    `corners`: (f, 3, 3) of the triangles, in spacings, so that node i lies at i.
    """
    low = np.maximum(np.ceil(corners.min(axis=1) - band), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1) + band), nodes - 1).astype(np.int64)
    size = np.maximum(high - low + 1, 0)
    share = np.cumsum(size.prod(axis=1)) // PAIRS_AT_A_TIME
    for chunk in range(int(share[-1]) + 1):
        mine = np.flatnonzero(share == chunk)
        if len(mine):
            yield _pairs(mine, low[mine], size[mine])


def _pairs(triangles: Indices, low: Indices, size: Indices) -> tuple[Indices, Indices]:
    """Return triangle (m,) and node (m, 3) for all nodes of a box at each of `triangles` (k,).

    `low`, `size`: (k, 3) first node and number of nodes of each box.
    """
    count = size.prod(axis=1)
    box = np.repeat(np.arange(len(triangles)), count)
    within = np.arange(len(box)) - np.repeat(np.cumsum(count) - count, count)
    yz, z = size[box, 1] * size[box, 2], size[box, 2]
    offset = np.stack([within // yz, within % yz // z, within % z], axis=1)
    return triangles[box], low[box] + offset


def closest_points(triangles: Array, points: Array) -> Array:
    """Return (n, 3) the point of each of `triangles` (n, 3, 3) closest to `points` (n, 3)."""
    a, b, c = triangles.swapaxes(0, 1)
    edges = ((a, b), (b, c), (c, a))
    best = np.full(len(points), np.inf)
    close = np.zeros_like(points)
    for start, end in edges:
        along = end - start
        length = np.maximum(np.einsum("ni,ni->n", along, along), 1e-30)
        share = np.clip(np.einsum("ni,ni->n", points - start, along) / length, 0.0, 1.0)
        foot = start + share[:, None] * along
        gap = ((points - foot) ** 2).sum(axis=1)
        nearer = gap < best
        best[nearer], close[nearer] = gap[nearer], foot[nearer]
    normal = np.cross(b - a, c - a)
    area = np.maximum(np.einsum("ni,ni->n", normal, normal), 1e-30)
    height = np.einsum("ni,ni->n", points - a, normal) / area
    foot = points - height[:, None] * normal
    sides = [np.cross(end - start, foot - start) for start, end in edges]
    over = np.all([np.einsum("ni,ni->n", side, normal) >= 0.0 for side in sides], axis=0)
    close[over] = foot[over]
    return close


def _inside(mesh: Mesh, origin: Array, spacing: float, nodes: int) -> Mask:
    """Return (nodes, nodes, nodes) which nodes the mesh encloses, by vote of the three axes.

    A column of nodes along an axis votes by how many surfaces lie before each node. One that
    crosses an odd number of surfaces passes through a hole, or slips between two triangles: it
    abstains. So a mesh with holes has a sign too, wrong at most near the holes.
    """
    votes = np.zeros((nodes,) * 3, np.int64)
    for axis in range(3):
        votes += np.moveaxis(_column_votes(mesh, origin, spacing, nodes, axis), 2, axis)
    return votes > 0


def _column_votes(
    mesh: Mesh, origin: Array, spacing: float, nodes: int, axis: int
) -> NDArray[np.int64]:
    """Return (nodes, nodes, nodes), 1 inside, -1 outside, 0 unknown; nodes along `axis` last."""
    others = [i for i in range(3) if i != axis]
    first, second = np.meshgrid(np.arange(nodes), np.arange(nodes), indexing="ij")
    start = np.zeros((nodes * nodes, 3))
    start[:, others[0]], start[:, others[1]] = first.ravel(), second.ravel()
    start = origin + spacing * (start + OFF_GRID * np.array([1.0, 1.7, 2.3]))
    start[:, axis] = origin[axis] - spacing
    direction = np.broadcast_to(np.eye(3)[axis], start.shape)
    crossings = line_crossings(mesh, start, direction, (nodes + 2) * spacing)
    heights = spacing * np.arange(1, nodes + 1)  # of the nodes above the columns' starts
    before = np.zeros((nodes * nodes, nodes), np.int64)
    for distance in crossings.distance.T:
        before += heights > distance[:, None]
    known = crossings.count % 2 == 0
    votes = np.where(known[:, None], 2 * (before % 2) - 1, 0)
    return votes.reshape(nodes, nodes, nodes)
