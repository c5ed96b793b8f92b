"""Distances to triangles in single precision, bit for bit as in ray-tracing kernels.

GraspNet's evaluator rejects a contact where the distance along the finger's path is linear up to
1e-10, which on flat faces depends on the last bits of a float. Its verdicts need the same bits, so
the order of every sum here is part of the result.
"""

from dataclasses import replace

import numpy as np

from pipelines.array_types import Array, Indices, Singles
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.signed_distance import (
    NODES,
    SignedDistanceGrid,
    node_pairs,
    signed_distance_grid,
)
from pipelines.geometry.transforms import unit

IN_PLANE = 1e-30  # metres, instead of a height of zero
TOUCHING = 1e-3  # spacings; a node nearer than this counts as on the surface
BAND = 2.5  # spacings; contacts and normals are read from nodes within 2.3


def single_precision_grid(mesh: Mesh, nodes: int = NODES) -> SignedDistanceGrid:
    """Return `signed_distance_grid` with the values within `BAND` in single precision.

    Contacts depend on these values only; the others merely say that the surface is far.
    """
    grid = signed_distance_grid(mesh, nodes)
    shape = grid.values.shape
    best = np.full(grid.values.size, np.inf, np.float32)
    sign = np.sign(grid.values).ravel()
    corners = mesh.triangles.astype(np.float32)
    for triangle, node in node_pairs((mesh.triangles - grid.origin) / grid.spacing, nodes, BAND):
        places = (grid.origin + grid.spacing * node).astype(np.float32)
        flat = np.ravel_multi_index((node[:, 0], node[:, 1], node[:, 2]), shape)
        gap = distances(places, corners[triangle])
        np.fmin.at(best, flat, gap)  # the distance of a triangle without area is nan
        touching = gap < TOUCHING * grid.spacing
        height = _heights(places[touching], corners[triangle[touching]])
        _settle_signs(sign, flat[touching], gap[touching], height)
    near = (best < BAND * grid.spacing).reshape(shape)
    values = (best * sign).reshape(shape)
    return replace(grid, values=np.where(near, values, grid.values).astype(np.float64))


def _heights(points: Singles, triangles: Singles) -> Array:
    """Return the exact height (n,) of points above their triangles' planes, metres.

    A ray along (1, 1, 1) from a point in the plane itself counts as crossing the triangle: the
    point is inside if the ray leaves the body there, outside if it enters.
    """
    corner = triangles.astype(np.float64)
    normal = unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    height = np.einsum("ni,ni->n", points - corner[:, 0], normal)
    leaving = np.sign(normal.sum(axis=1))
    return np.asarray(np.where(height == 0.0, -IN_PLANE * leaving, height))


def _settle_signs(sign: Array, node: Indices, gap: Singles, height: Array) -> None:
    """Set the sign of nodes within rounding of the surface by their nearest triangle.

    There the side of the face is known exactly, and the parity of a ray's crossings is not.
    """
    order = np.lexsort((height, -np.abs(height), gap, node))
    settled, first = np.unique(node[order], return_index=True)
    decided = height[order[first]]
    sign[settled] = np.where(decided < 0.0, -1.0, 1.0)


def distances(
    points: Singles,  # (n, 3)
    triangles: Singles,  # (n, 3, 3)
) -> Singles:
    """Return the distance (n,) of each point to its triangle.

    Signed areas decide whether the nearest point is a corner, on an edge or inside.
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    ab, ac = b - a, c - a
    d1, d2 = _dot(ab, points - a), _dot(ac, points - a)
    d3, d4 = _dot(ab, points - b), _dot(ac, points - b)
    d5, d6 = _dot(ab, points - c), _dot(ac, points - c)
    area_c, area_b, area_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    with np.errstate(divide="ignore", invalid="ignore"):  # in cases that are not selected
        share = np.float32(1.0) / (area_a + area_b + area_c)
        inside = (a + (area_b * share)[:, None] * ab) + (area_c * share)[:, None] * ac
        on_bc = b + ((d4 - d3) / ((d4 - d3) + (d5 - d6)))[:, None] * (c - b)
        on_ac = a + (d2 / (d2 - d6))[:, None] * ac
        on_ab = a + (d1 / (d1 - d3))[:, None] * ab
    conditions = [  # the first that holds decides
        (d1 <= 0) & (d2 <= 0),
        (d3 >= 0) & (d4 <= d3),
        (d6 >= 0) & (d5 <= d6),
        (area_c <= 0) & (d1 >= 0) & (d3 <= 0),
        (area_b <= 0) & (d2 >= 0) & (d6 <= 0),
        (area_a <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0),
    ]
    choices = [a, b, c, on_ab, on_ac, on_bc]
    closest = np.select([each[:, None] for each in conditions], choices, inside)
    gap = np.square(points - closest)
    return np.asarray(np.sqrt((gap[:, 0] + gap[:, 1]) + gap[:, 2]))


def _dot(a: Singles, b: Singles) -> Singles:
    product = a * b
    return np.asarray((product[:, 0] + product[:, 2]) + product[:, 1])  # SSE's order of lanes
