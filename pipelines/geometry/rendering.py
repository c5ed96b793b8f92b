"""Ray casting against posed meshes: views of a camera, and contacts of fingers.

The search finds the triangle, in single precision with Embree; the distance is then computed in
double precision from the plane of that triangle.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices, Mask
from pipelines.errors import ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.ray_search import ray_search
from pipelines.geometry.transforms import invert, rotate_vectors, transform_points, unit

# Metres, and share of the distance, by which the search in single precision may be off.
SEARCH_ERROR = 1e-3


@dataclass(frozen=True)
class Hits:
    """First hits of the rays through the pixels of a view."""

    depth: Array  # (H, W) metres along z, 0 where nothing is hit
    object_index: Indices  # (H, W) index of the object in the scene, -1 where nothing is hit
    triangle_index: Indices  # (H, W) index of the triangle in that object's mesh, or -1
    normal: Array  # (H, W, 3) unit, camera frame, toward the camera; zero where nothing is hit


class Scene:
    """Search structure for rays against posed meshes, built once for many casts.

    `meshes` are in their own frames, `poses` (4, 4) map each to the world frame.
    """

    def __init__(self, meshes: Sequence[Mesh], poses: Sequence[ArrayLike]) -> None:
        if not meshes or len(meshes) != len(poses):
            raise ValueRangeError(
                "numbers of meshes and poses", (len(meshes), len(poses)), "equal, at least 1"
            )
        triangles = [
            transform_points(pose, mesh.triangles) for mesh, pose in zip(meshes, poses, strict=True)
        ]
        self._triangles = np.concatenate(triangles)
        self._starts = np.cumsum([0, *(len(part) for part in triangles)])
        # Single precision is finest near the origin, so the search runs about the centre.
        self._center = 0.5 * (self._triangles.min(axis=(0, 1)) + self._triangles.max(axis=(0, 1)))
        a, b, c = self._triangles.swapaxes(0, 1)
        self._normals = unit(np.cross(b - a, c - a))
        self._search = ray_search(self._triangles - self._center)

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Indices]:
        """Return distance (n,) and triangle (n,) of each ray's first hit; inf and -1 if it misses.

        `origins` (n, 3) metres and `directions` (n, 3) of any length, world frame; triangles are
        numbered through all objects.
        """
        o = np.asarray(origins, np.float64).reshape(-1, 3)
        d = unit(np.asarray(directions, np.float64).reshape(-1, 3))
        if not len(o):
            return np.zeros(0), np.zeros(0, np.int64)
        triangle, searched = self._search.first(o - self._center, d)
        hit = triangle >= 0
        distance = np.full(len(o), np.inf)
        normal, corner = self._normals[triangle[hit]], self._triangles[triangle[hit], 0]
        slope = np.einsum("ij,ij->i", d[hit], normal)
        ahead = np.einsum("ij,ij->i", corner - o[hit], normal)
        # A ray in the triangle's plane does not cross it and keeps the distance of the search.
        with np.errstate(divide="ignore", invalid="ignore"):
            exact = ahead / slope
        rough = searched[hit]
        is_near = np.abs(exact - rough) < SEARCH_ERROR * (1.0 + rough)
        distance[hit] = np.where(is_near, exact, rough)
        return distance, triangle

    def occluded(self, origins: ArrayLike, directions: ArrayLike) -> Mask:
        """Return whether each ray hits anything; `origins`, `directions` (n, 3), world frame."""
        o = np.asarray(origins, np.float64).reshape(-1, 3)
        return self._search.any(o - self._center, np.asarray(directions).reshape(-1, 3))

    def owner(self, triangle: Indices) -> tuple[Indices, Indices]:
        """Return the object (n,) of each `triangle` (n,), and its index (n,) in that object's mesh.

        A triangle of -1 gives -1.
        """
        index = np.searchsorted(self._starts, triangle, side="right") - 1
        none = triangle < 0
        return (
            np.where(none, -1, index),
            np.where(none, -1, triangle - self._starts[np.maximum(index, 0)]),
        )

    def normals(self, triangle: Indices) -> Array:
        """Return the outward unit normals (..., 3), world frame, of `triangle`; zero for -1."""
        return np.where((triangle >= 0)[..., None], self._normals[triangle], 0.0)


def cast_view(scene: Scene, intrinsics: Intrinsics, T_world_cam: ArrayLike) -> Hits:
    """Cast the rays of a camera at `T_world_cam` (4, 4) into `scene`."""
    pose = np.asarray(T_world_cam, np.float64)
    rays = intrinsics.rays().reshape(-1, 3)
    directions = rotate_vectors(pose, rays)
    distance, triangle = scene.cast(np.broadcast_to(pose[:3, 3], directions.shape), directions)
    size = (intrinsics.height, intrinsics.width)
    depth = np.where(triangle >= 0, distance / np.linalg.norm(rays, axis=1), 0.0)
    normal = rotate_vectors(invert(pose), scene.normals(triangle))
    away = np.einsum("ij,ij->i", normal, rays) > 0
    objects, own = scene.owner(triangle)
    return Hits(
        depth.reshape(size),
        objects.reshape(size),
        own.reshape(size),
        np.where(away[:, None], -normal, normal).reshape(*size, 3),
    )


_SCENES: WeakKeyDictionary[Mesh, Scene] = WeakKeyDictionary()


def first_hits(mesh: Mesh, origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Indices]:
    """Return distance (n,) and triangle (n,) of each ray's first hit; inf and -1 if it misses.

    `origins` (n, 3) metres and `directions` (n, 3), frame of `mesh`. The search structure is
    built at the first call and lives as long as the mesh.
    """
    if mesh not in _SCENES:
        _SCENES[mesh] = Scene([mesh], [np.eye(4)])
    return _SCENES[mesh].cast(origins, directions)
