"""Convex pieces of meshes, for physics."""

import numpy as np
import trimesh
from scipy.spatial import QhullError

from pipelines.array_types import Array
from pipelines.errors import SymgraspError
from pipelines.geometry.meshes import convex_decomposition
from pipelines.geometry.meshes.mesh import Mesh

CONVEX_ENOUGH = 0.95  # least share of its convex hull's volume that a mesh fills
CONCAVITY = 0.08  # coacd's measure; fine enough for objects to fall and come to rest realistically
MAX_PIECES = 12
# To make a mesh manifold, coacd samples it on twice as many cells along its largest side. Its
# default of 50 gives 100,000 triangles and takes minutes.
MANIFOLD_CELLS = 30
# coacd cuts an open surface as a shell of 12 pieces, with its own settings for minutes.
OPEN_SEARCH = {"mcts_iterations": 40, "mcts_max_depth": 2, "resolution": 1000}


def hull_of_points(points: Array) -> Mesh:
    """Return the convex hull of `points` (n, 3).

    Raises:
        SymgraspError: the points are in a plane, as the corners of a single triangle.
    """
    try:
        # For flat points trimesh divides by a volume of 0 to compute a centre, not used here.
        with np.errstate(divide="ignore", invalid="ignore"):
            hull = trimesh.convex.convex_hull(points)
    except QhullError as error:
        raise SymgraspError(
            f"the {len(points)} corners of a mesh span no volume; physics needs a solid, so give a "
            "mesh of a closed surface"
        ) from error
    return Mesh(np.asarray(hull.vertices), np.asarray(hull.faces))


def without_small_holes(mesh: Mesh) -> Mesh:
    """Return `mesh` without triangles of area 0, and with holes of 3 or 4 edges filled.

    coacd treats a solid that lacks one triangle as a shell, and cuts it for a minute.
    """
    if mesh.is_watertight:
        return mesh
    corners = mesh.faces[(mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1)]
    filled = trimesh.Trimesh(mesh.vertices, corners, process=False)
    trimesh.repair.fill_holes(filled)
    return Mesh(mesh.vertices, np.asarray(filled.faces))


def is_nearly_convex(mesh: Mesh, convex_enough: float = CONVEX_ENOUGH) -> bool:
    """Return whether a mesh fills its hull; False with large holes, which leave no volume."""
    mesh = without_small_holes(mesh)
    hull = hull_of_points(mesh.vertices)
    return mesh.is_watertight and mesh.volume > convex_enough * hull.volume


def physics_pieces(
    mesh: Mesh,
    *,
    convex_enough: float = CONVEX_ENOUGH,
    concavity: float = CONCAVITY,
    max_pieces: int = MAX_PIECES,
    seed: int = 0,
) -> tuple[Mesh, ...]:
    """Return convex meshes that together fill `mesh`: only its hull if the hull is close enough.

    `concavity`: largest concavity of a piece, by coacd's measure.
    """
    hull = hull_of_points(mesh.vertices)
    if is_nearly_convex(mesh, convex_enough):
        return (hull,)
    settings = {
        "threshold": concavity,
        "max_convex_hull": max_pieces,
        "preprocess_resolution": MANIFOLD_CELLS,
        "seed": seed,
    }
    solid = without_small_holes(mesh)
    if not solid.is_watertight:
        settings |= OPEN_SEARCH
    pieces = convex_decomposition.decomposed(solid, settings)
    return tuple(hull_of_points(corners) for corners in pieces) or (hull,)
