"""Signed-distance grids of meshes (dex-net's recipe: 100 nodes, 5 of margin on each side).

Distances are exact within NARROW_BAND nodes of the surface. A node farther away takes the closest
surface point of the band's nearest node: its distance is up to one spacing too long, never short.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pipelines.array_types import Array, Indices, Mask, Vector
from pipelines.geometry.meshes.line_crossings import line_crossings
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.numerics.compiled import compiled

NODES = 100  # along each edge of the grid
MARGIN = 5  # nodes free on each side of the mesh's longest extent
NARROW_BAND = 2.5  # spacings
PAIRS_AT_A_TIME = 400_000  # (triangle, node) pairs held in memory
NO_LENGTH = 1e-30  # squared spacings
# (3,) spacings that a column is shifted, so that rays miss edges and vertices
OFF_GRID = 1.234e-5 * np.array([1.0, 1.7, 2.3])


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
    """Return the surface point closest to each node (nodes, nodes, nodes, 3); nan off the band."""
    corners = (mesh.triangles - origin) / spacing  # in spacings, so that node i lies at i
    low, high = _node_boxes(corners, nodes)
    feet = _closest_feet(corners, np.ascontiguousarray(mesh.face_normals), low, high, nodes)
    return (feet * spacing + origin).reshape(nodes, nodes, nodes, 3)


def _node_boxes(corners: Array, nodes: int) -> tuple[Indices, Indices]:
    """Return the first and the last node (f, 3) of the box within the band of each triangle.

    `corners`: (f, 3, 3) of the triangles, in spacings, so that node i lies at i. For a triangle off
    the grid, the last node comes before the first.
    """
    low = np.maximum(np.ceil(corners.min(axis=1) - NARROW_BAND), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1) + NARROW_BAND), nodes - 1).astype(np.int64)
    return low, high


def node_pairs(corners: Array) -> Iterator[tuple[Indices, Indices]]:
    """Yield triangle (m,) and node (m, 3) of all pairs that may be within the band, in chunks.

    `corners`: (f, 3, 3) of the triangles, in spacings, so that node i of `NODES` lies at i.
    """
    low, high = _node_boxes(corners, NODES)
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


@compiled
def _closest_feet(corners: Array, normals: Array, low: Indices, high: Indices, nodes: int) -> Array:
    """Return the point (nodes^3, 3) of the nearest triangle; of equally near ones, the first."""
    feet, best = np.full((nodes**3, 3), np.nan), np.full(nodes**3, np.inf)
    for t in range(len(corners)):
        a, b, c = _place(corners[t, 0]), _place(corners[t, 1]), _place(corners[t, 2])
        normal = _place(normals[t])
        for x in range(low[t, 0], high[t, 0] + 1):
            for y in range(low[t, 1], high[t, 1] + 1):
                for z in range(low[t, 2], high[t, 2] + 1):
                    node, at = (float(x), float(y), float(z)), (x * nodes + y) * nodes + z
                    # The distance to the plane is quick to compute and excludes half of the nodes.
                    if abs(_dot(_minus(node, a), normal)) > NARROW_BAND:
                        continue
                    foot = _closest(a, b, c, node)
                    way = _minus(node, foot)
                    gap = np.sqrt(_dot(way, way))
                    if gap <= NARROW_BAND and gap < best[at]:
                        feet[at], best[at] = foot, gap
    return feet


@compiled
def _closest(a: Vector, b: Vector, c: Vector, point: Vector) -> Vector:
    """Return the point of the triangle a, b, c closest to `point`."""
    close, best = a, np.inf
    for start, end in ((a, b), (b, c), (c, a)):
        edge = _minus(end, start)
        share = _dot(_minus(point, start), edge) / max(_dot(edge, edge), NO_LENGTH)
        foot = _plus(start, min(max(share, 0.0), 1.0), edge)
        way = _minus(point, foot)
        if _dot(way, way) < best:
            close, best = foot, _dot(way, way)
    normal = _cross(_minus(b, a), _minus(c, a))
    area = _dot(normal, normal)
    if area <= NO_LENGTH:  # no area: only its edges
        return close
    foot = _plus(point, -_dot(_minus(point, a), normal) / area, normal)
    for start, end in ((a, b), (b, c), (c, a)):
        if _dot(_cross(_minus(end, start), _minus(foot, start)), normal) < 0.0:
            return close
    return foot


@compiled
def _place(row: Array) -> Vector:
    return row[0], row[1], row[2]


@compiled
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def _plus(a: Vector, share: float, b: Vector) -> Vector:
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@compiled
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _inside(mesh: Mesh, origin: Array, spacing: float, nodes: int) -> Mask:
    """Return a mask (nodes, nodes, nodes) of the nodes inside the mesh, by vote of the three axes.

    A column of nodes along an axis votes by the number of surfaces before each node. A column that
    crosses an odd number of surfaces passes through a hole or between two triangles, and abstains.
    So a mesh with holes has a sign too, wrong at most near the holes.
    """
    votes = np.zeros((nodes,) * 3, np.int64)
    for axis in range(3):
        votes += np.moveaxis(_column_votes(mesh, origin, spacing, nodes, axis), 2, axis)
    return votes > 0


def _column_votes(
    mesh: Mesh, origin: Array, spacing: float, nodes: int, axis: int
) -> NDArray[np.int64]:
    """Return votes (nodes, nodes, nodes): 1 inside, -1 outside, 0 unknown; `axis` is last."""
    others = [i for i in range(3) if i != axis]
    first, second = np.meshgrid(np.arange(nodes), np.arange(nodes), indexing="ij")
    start = np.zeros((nodes * nodes, 3))
    start[:, others[0]], start[:, others[1]] = first.ravel(), second.ravel()
    start = origin + spacing * (start + OFF_GRID)
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
