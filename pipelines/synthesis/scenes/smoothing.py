"""Smooth shading: normals interpolated between a triangle's corners.

Only the colour image uses these normals; depth and grasps use the flat triangles.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import Hits
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points, unit

CREASE = np.radians(35.0)  # between faces; a sharper bend is an edge


def corner_normals(mesh: Mesh) -> Array:
    """Return unit normals (f, 3, 3) at each triangle's corners, frame of the mesh."""
    sums = np.zeros_like(mesh.vertices)
    weighted = mesh.face_normals * mesh.face_areas[:, None]
    for corner in range(3):
        np.add.at(sums, mesh.faces[:, corner], weighted)
    smooth = unit(sums)[mesh.faces]
    bend = np.einsum("fki,fi->fk", smooth, mesh.face_normals)
    return np.where((bend > np.cos(CREASE))[..., None], smooth, mesh.face_normals[:, None])


def with_smooth_normals(
    hits: Hits,
    meshes: Sequence[Mesh],
    corners: Sequence[Array],
    T_cam_obj: Array,
    intrinsics: Intrinsics,
) -> Hits:
    """Return `hits` with interpolated normals on the first k objects of the scene.

    `corners`: `corner_normals` of each of `meshes`; `T_cam_obj`: (k, 4, 4) their poses.
    """
    normal = hits.normal.copy()
    rays = intrinsics.rays()
    for index, mesh in enumerate(meshes):
        seen = hits.object_index == index
        if not seen.any():
            continue
        triangle, ray = hits.triangle_index[seen], rays[seen]
        points = transform_points(invert(T_cam_obj[index]), ray * hits.depth[seen][:, None])
        weights = barycentric(mesh.triangles[triangle], points)
        own = np.einsum("nk,nki->ni", weights, corners[index][triangle])
        smooth = unit(rotate_vectors(T_cam_obj[index], own))
        # Near a silhouette an interpolated normal may point away from the camera.
        facing = np.einsum("ni,ni->n", smooth, ray) < 0.0
        normal[seen] = np.where(facing[:, None], smooth, normal[seen])
    return replace(hits, normal=normal)


def barycentric(triangles: Array, points: Array) -> Array:
    """Return the barycentric coordinates (n, 3) of `points` (n, 3) in `triangles` (n, 3, 3).

    A point outside of its triangle gets the coordinates of a point on the border.
    """
    a, b, c = triangles.swapaxes(0, 1)
    u, v, w = b - a, c - a, points - a
    uu, uv, vv = (np.einsum("ni,ni->n", p, q) for p, q in ((u, u), (u, v), (v, v)))
    wu, wv = np.einsum("ni,ni->n", w, u), np.einsum("ni,ni->n", w, v)
    area = np.maximum(uu * vv - uv * uv, 1e-30)
    second, third = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    shares = np.clip(np.stack([1.0 - second - third, second, third], 1), 0.0, None)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))
