"""Convex pieces of any mesh, for physics (coacd)."""

import coacd
import numpy as np
import trimesh
from numpy.typing import NDArray

from pipelines.geometry.mesh import Mesh

CONVEX_ENOUGH = 0.95  # share of its convex hull's volume that a mesh fills


def hull_of_points(points: NDArray[np.float64]) -> Mesh:
    """Return the convex hull of `points` (n, 3)."""
    hull = trimesh.convex.convex_hull(points)
    return Mesh(np.asarray(hull.vertices), np.asarray(hull.faces))


def convex_pieces(mesh: Mesh, *, seed: int = 0) -> tuple[Mesh, ...]:
    """Return convex meshes that together fill `mesh`: its hull if that is close enough."""
    hull = hull_of_points(mesh.vertices)
    if mesh.is_watertight and mesh.volume > CONVEX_ENOUGH * hull.volume:
        return (hull,)
    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces), threshold=0.08, max_convex_hull=12, seed=seed
    )
    pieces = [Mesh(np.asarray(v), np.asarray(f)) for v, f in parts if len(v) >= 4]
    return tuple(pieces) if pieces else (hull,)
