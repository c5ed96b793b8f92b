"""Distances to triangles in single precision, bit for bit as in ray-tracing kernels.

GraspNet's evaluator rejects a contact if the distance along the finger's path is linear up to
1e-10, which on flat faces depends on the last bits of a float. Equal verdicts need equal bits, so
the order of every sum here matters.
"""

from dataclasses import replace

import numpy as np

from pipelines.array_types import Array, Indices, Singles, SingleVector
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.signed_distance import (
    NARROW_BAND,
    SignedDistanceGrid,
    node_pairs,
    signed_distance_grid,
)
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.transforms import unit

IN_PLANE = 1e-30  # metres, instead of a height of zero
TOUCHING = 1e-3  # spacings; a node nearer than this counts as on the surface


def single_precision_grid(mesh: Mesh) -> SignedDistanceGrid:
    """Return `signed_distance_grid` with the values within `NARROW_BAND` in single precision.

    Contacts and normals are read from nodes within 2.3 spacings; all other values only mean that
    the surface is far.
    """
    grid = signed_distance_grid(mesh)
    shape = grid.values.shape
    best = np.full(grid.values.size, np.inf, np.float32)
    sign = np.sign(grid.values).ravel()
    corners = mesh.triangles.astype(np.float32)
    for triangle, node in node_pairs((mesh.triangles - grid.origin) / grid.spacing):
        places = (grid.origin + grid.spacing * node).astype(np.float32)
        flat = np.ravel_multi_index((node[:, 0], node[:, 1], node[:, 2]), shape)
        gap = distances(places, corners[triangle])
        np.fmin.at(best, flat, gap)  # the distance to a triangle without area is nan
        touching = gap < TOUCHING * grid.spacing
        height = _heights(places[touching], corners[triangle[touching]])
        _settle_signs(sign, flat[touching], gap[touching], height)
    near = (best < NARROW_BAND * grid.spacing).reshape(shape)
    values = (best * sign).reshape(shape)
    return replace(grid, values=np.where(near, values, grid.values).astype(np.float64))


def _heights(points: Singles, triangles: Singles) -> Array:
    """Return the exact height (n,) of points above their triangles' planes, metres.

    A ray along (1, 1, 1) from a point in the plane counts as crossing the triangle: the point is
    inside if the ray leaves the body there, outside if the ray enters.
    """
    corner = triangles.astype(np.float64)
    normal = unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    height = np.einsum("ni,ni->n", points - corner[:, 0], normal)
    leaving = np.sign(normal.sum(axis=1))
    return np.asarray(np.where(height == 0.0, -IN_PLANE * leaving, height))


def _settle_signs(sign: Array, node: Indices, gap: Singles, height: Array) -> None:
    """Set the sign of nodes within rounding of the surface by their nearest triangle.

    There the side of the face is exact, but the parity of a ray's crossings is not.
    """
    order = np.lexsort((height, -np.abs(height), gap, node))
    settled, first = np.unique(node[order], return_index=True)
    decided = height[order[first]]
    sign[settled] = np.where(decided < 0.0, -1.0, 1.0)


@compiled
def distances(points: Singles, triangles: Singles) -> Singles:
    """Return the distance (n,) of each of `points` (n, 3) to its triangle of `triangles` (n, 3, 3).

    Signed areas decide whether the nearest point is a corner, on an edge or inside.
    """
    gaps = np.empty(len(points), np.float32)
    for n in range(len(points)):
        a, b, c = triangles[n, 0], triangles[n, 1], triangles[n, 2]
        point = _place(points[n])
        way = _minus(point, _closest(_place(a), _place(b), _place(c), point))
        gaps[n] = np.sqrt((way[0] * way[0] + way[1] * way[1]) + way[2] * way[2])
    return gaps


@compiled
def _closest(  # noqa: PLR0911 - one per case
    a: SingleVector, b: SingleVector, c: SingleVector, point: SingleVector
) -> SingleVector:
    """Return the point of the triangle a, b, c closest to `point`; nan if the area is 0."""
    ab, ac = _minus(b, a), _minus(c, a)
    d1, d2 = _dot(ab, _minus(point, a)), _dot(ac, _minus(point, a))
    d3, d4 = _dot(ab, _minus(point, b)), _dot(ac, _minus(point, b))
    d5, d6 = _dot(ab, _minus(point, c)), _dot(ac, _minus(point, c))
    area_c, area_b, area_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if d1 <= 0 and d2 <= 0:
        return a
    if d3 >= 0 and d4 <= d3:
        return b
    if d6 >= 0 and d5 <= d6:
        return c
    if area_c <= 0 and d1 >= 0 and d3 <= 0:
        return _plus(a, d1 / (d1 - d3), ab)
    if area_b <= 0 and d2 >= 0 and d6 <= 0:
        return _plus(a, d2 / (d2 - d6), ac)
    if area_a <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        return _plus(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), _minus(c, b))
    share = np.float32(1.0) / (area_a + area_b + area_c)
    return _plus(_plus(a, area_b * share, ab), area_c * share, ac)


@compiled
def _place(row: Singles) -> SingleVector:
    return row[0], row[1], row[2]


@compiled
def _dot(a: SingleVector, b: SingleVector) -> np.float32:
    return (a[0] * b[0] + a[2] * b[2]) + a[1] * b[1]  # SSE's order of lanes


@compiled
def _minus(a: SingleVector, b: SingleVector) -> SingleVector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def _plus(a: SingleVector, share: np.float32, b: SingleVector) -> SingleVector:
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]
