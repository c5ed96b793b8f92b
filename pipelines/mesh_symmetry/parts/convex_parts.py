"""Nearly convex parts (limbs, heads, handles) of an object without symmetry, by coacd."""

import numpy as np
from scipy.spatial import ConvexHull, KDTree, QhullError

from pipelines.array_types import Array, Indices
from pipelines.geometry.meshes.convex_decomposition import decomposed
from pipelines.geometry.meshes.mesh import Mesh

# coacd's defaults take half a minute per object; these settings find the same large pieces.
COARSE_SEARCH = {
    "threshold": 0.15,
    "max_convex_hull": 6,
    "seed": 0,
    "preprocess_resolution": 20,
    "resolution": 500,
    "mcts_nodes": 8,
    "mcts_iterations": 20,
    "mcts_max_depth": 1,
}


def convex_owner(mesh: Mesh, points: Array) -> Indices:
    """Return the index (n,) of the nearly convex piece of `mesh` around each of `points` (n, 3).

    All 0 if coacd finds no pieces.
    """
    used, index = np.unique(mesh.faces, return_inverse=True)
    hulls = decomposed(Mesh(mesh.vertices[used], index.reshape(-1, 3)), COARSE_SEARCH)
    if not hulls:
        return np.zeros(len(points), dtype=np.int64)
    depth = np.stack([_outside(corners, points) for corners in hulls])
    return np.asarray(depth.argmin(axis=0))


def _outside(corners: Array, points: Array) -> Array:
    """Return the distance (n,) of `points` (n, 3) from the hull of `corners`; negative inside."""
    try:
        equations = ConvexHull(corners, qhull_options="QJ").equations
    except QhullError:
        return np.asarray(KDTree(corners).query(points)[0])
    return np.asarray((points @ equations[:, :3].T + equations[:, 3]).max(axis=1))
