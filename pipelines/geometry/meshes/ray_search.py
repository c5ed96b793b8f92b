"""First triangles on rays: by Embree where it is installed, else by a tree of our own.

Embree has no wheel for ARM Linux. It searches in single precision, the tree in double: they differ
where a ray passes an edge within a ten-millionth of the scene's size.
"""

from typing import Any

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.numerics import ray_tree

try:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene
except ImportError:  # `doctor` says so
    EmbreeScene = None


class EmbreeSearch:
    """Embree's search among `triangles` (t, 3, 3), best about the origin: single precision.

    Rays start at `origins` (r, 3) along `directions` (r, 3).
    """

    def __init__(self, triangles: Array) -> None:
        self._scene = EmbreeScene()
        # Embree refers to the mesh's buffers, so they live as long as the scene.
        self._mesh = TriangleMesh(self._scene, triangles.astype(np.float32))

    def first(self, origins: Array, directions: Array) -> tuple[Indices, Array]:
        """Return the first triangle (r,) of each ray, -1 for none, and its distance (r,)."""
        found = self._run(origins, directions, output=1)
        triangle = np.where(found["geomID"] >= 0, found["primID"], -1).astype(np.int64)
        return triangle, found["tfar"].astype(np.float64)

    def any(self, origins: Array, directions: Array) -> Mask:
        """Return (r,) whether each ray hits anything."""
        return np.asarray(self._run(origins, directions, query="OCCLUDED") >= 0)

    def _run(self, origins: Array, directions: Array, **options: object) -> Any:  # noqa: ANN401
        return self._scene.run(origins.astype(np.float32), directions.astype(np.float32), **options)


class TreeSearch:
    """A search of our own among `triangles` (t, 3, 3), some times slower than Embree's."""

    def __init__(self, triangles: Array) -> None:
        fixed = np.ascontiguousarray(triangles).view()
        fixed.flags.writeable = False  # as meshes' are: the loop is compiled for one kind
        self._tree = ray_tree.built(fixed)
        self._triangles = np.ascontiguousarray(triangles[self._tree[0]])

    def first(self, origins: Array, directions: Array) -> tuple[Indices, Array]:
        """Return the first triangle (r,) of each ray, -1 for none, and its distance (r,)."""
        return self._cast(origins, directions, any_hit=False)

    def any(self, origins: Array, directions: Array) -> Mask:
        """Return (r,) whether each ray hits anything."""
        return np.asarray(self._cast(origins, directions, any_hit=True)[0] >= 0)

    def _cast(self, origins: Array, directions: Array, any_hit: bool) -> tuple[Indices, Array]:
        o, d = (np.ascontiguousarray(rays, np.float64) for rays in (origins, directions))
        return ray_tree.cast(self._triangles, self._tree, o, d, any_hit)


def has_embree() -> bool:
    """Return whether rays are cast by Embree."""
    return EmbreeScene is not None


def ray_search(triangles: Array) -> EmbreeSearch | TreeSearch:
    """Return a search among `triangles` (t, 3, 3)."""
    return EmbreeSearch(triangles) if has_embree() else TreeSearch(triangles)
