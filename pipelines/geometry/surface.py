"""The surface of a mesh as something to measure distances to."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree, QhullError
from scipy.spatial.distance import pdist
from trimesh.triangles import closest_point

from pipelines.geometry.mesh import Mesh, sample_surface
from pipelines.geometry.transforms import unit

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MAX_HULL_CORNERS = 2000
NUM_SMOOTHED = 16  # samples that a normal is averaged over
SAME_SIDE_COSINE = 0.3  # the other faces of an edge and of a thin wall do not count


@dataclass(frozen=True)
class Surface:
    """A triangle mesh with evenly spread surface samples and a tree over them.

    The normals are averaged over neighbours of the same side, for scans whose triangles are rough.

    `triangles`: (f, 3, 3), `points` and `normals`: (m, 3), `faces`: (m,) the triangle that each
    sample lies on; unit of the mesh, frame of the mesh. Samples rather than vertices are the
    base of every search, so the tessellation does not matter.
    """

    triangles: Array
    points: Array
    normals: Array
    faces: Indices
    tree: KDTree

    @classmethod
    def from_mesh(cls, mesh: Mesh, num_samples: int, rng: np.random.Generator) -> "Surface":
        """Sample `mesh` at `num_samples` points, uniform by area."""
        points, normals, faces = sample_surface(mesh, num_samples, rng)
        tree = KDTree(points)
        return cls(mesh.triangles, points, _smoothed(tree, normals), faces, tree)

    def normalised(self, center: Array, size: float) -> "Surface":
        """Return the surface moved by -`center` (3,) and divided by `size`."""
        points = (self.points - center) / size
        triangles = (self.triangles - center) / size
        return Surface(triangles, points, self.normals, self.faces, KDTree(points))

    def nearest(self, points: Array) -> Indices:
        """Return the index of the sample nearest to each of `points`: (..., 3) -> (...)."""
        return np.asarray(self.tree.query(points)[1])

    def within(self, points: Array, reach: float) -> tuple[Array, Indices]:
        """Return distance and index (...) of the nearest sample, of any that is within `reach`.

        Elsewhere the distance is inf and the index 0. Far points cost next to nothing.
        """
        distance, index = self.tree.query(points, distance_upper_bound=reach)
        found = np.isfinite(distance)
        return np.asarray(distance), np.where(found, index, 0)

    def distances(
        self, points: Array, num_nearest: int = 3, reach: float = np.inf
    ) -> tuple[Array, Array]:
        """Return the distance to the surface (n,) and its unit normal there (n, 3).

        The triangles of the `num_nearest` nearest samples are tried, so the distance is exact
        where the nearest triangle is among them, and too long by far less than the sample
        spacing elsewhere. Points without a sample within `reach` are `reach` away, with any
        normal; they cost next to nothing. `points`: (n, 3).
        """
        found = self.tree.query(points, k=num_nearest, distance_upper_bound=reach)[1]
        candidates = np.asarray(found).reshape(len(points), num_nearest)
        missing = candidates == len(self.points)
        candidates = np.where(missing, 0, candidates)
        triangles = self.triangles[self.faces[candidates]].reshape(-1, 3, 3)
        foot: Array = closest_point(  # type: ignore[no-untyped-call]
            triangles, np.repeat(points, num_nearest, axis=0)
        )
        gap = np.linalg.norm(foot.reshape(*candidates.shape, 3) - points[:, None], axis=2)
        gap[missing] = reach
        best = gap.argmin(axis=1)
        rows = np.arange(len(points))
        return gap[rows, best], self.normals[candidates[rows, best]]


def _smoothed(tree: KDTree, normals: Array) -> Array:
    neighbours = normals[np.asarray(tree.query(tree.data, k=NUM_SMOOTHED)[1])]  # (m, k, 3)
    alike = np.einsum("mkd,md->mk", neighbours, normals) > SAME_SIDE_COSINE
    return unit(np.einsum("mkd,mk->md", neighbours, alike.astype(np.float64)))


def diameter(points: Array) -> float:
    """Return the largest distance between two of `points` (n, 3); it does not turn with them."""
    try:
        corners = points[ConvexHull(points, qhull_options="QJ").vertices]
    except QhullError:  # fewer than four points, or not a number of them
        corners = points
    stride = -(-len(corners) // MAX_HULL_CORNERS)
    return float(pdist(corners[::stride]).max())
