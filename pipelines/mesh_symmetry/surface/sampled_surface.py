"""Surfaces of meshes for distance queries: samples, normals, noise."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree
from trimesh.triangles import closest_point

from pipelines.array_types import Array, Indices
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.geometry.transforms import basis_from_direction, unit
from pipelines.mesh_symmetry.surface.open_boundary import OpenBoundary

NUM_SMOOTHED = 16  # samples over which a normal is averaged
SAME_SIDE_COSINE = 0.3  # between normals; excludes the other faces of an edge and of a thin wall
ROUGH_PASSES = 3  # passes of averaging if noise has tilted the triangles
ROUGH_AGREEMENT = 0.85  # factor: by passes neighbours share noise, a surface and its image do not
ROUGH_SLOPE = 0.03  # noise over the distance of the measured neighbours
NUM_PROBES, NUM_NEIGHBORS = 500, 40  # places where noise is measured, and samples around each
NUM_NEAREST = 10  # neighbours for the first fit at a place
TUKEY = 7.0  # of the median distance from the fit; farther neighbours are on another face
FAR_NEIGHBORS = 24  # farther neighbours do not share averaged normals
AGREEING_COSINE = 0.85  # of two normals: 32 degrees


@dataclass(frozen=True)
class Surface:
    """A triangle mesh with evenly spread surface samples and a k-d tree of them.

    Every search uses samples instead of vertices, so the tessellation does not matter. Unit and
    frame of the mesh.
    """

    triangles: Array  # (f, 3, 3)
    points: Array  # (m, 3) samples
    normals: Array  # (m, 3) averaged over neighbours of the same side, for rough scans
    faces: Indices  # (m,) triangle of each sample
    tree: KDTree
    rim: OpenBoundary  # where the surface ends
    noise: float  # standard deviation of samples from a smooth surface through their neighbours
    agreement: float  # share of neighbouring samples whose normals agree

    @classmethod
    def from_mesh(
        cls,
        mesh: Mesh,
        num_samples: int,
        rng: np.random.Generator,
        density: Array | None = None,
    ) -> "Surface":
        """Sample `mesh` at `num_samples` points, evenly by area times `density` (f,), if given."""
        points, normals, faces = sample_surface(mesh, num_samples, rng, density)
        tree = _tree(points)
        data = strided_at_least(np.arange(num_samples), NUM_PROBES)
        found = tree.query(points[data], k=min(NUM_NEIGHBORS, num_samples))
        distance, index = (np.asarray(part) for part in found)
        # Noise tilts triangles so far that their normals do not separate the sides of a thin wall.
        rough = _smoothed(tree, normals, ROUGH_PASSES)
        noise, slope = _noise(points[index] - points[data][:, None], rough[index], distance)
        is_rough = slope > ROUGH_SLOPE
        normals = rough if is_rough else _smoothed(tree, normals, 1)
        agreement = _agreement(normals[index[:, FAR_NEIGHBORS:]], normals[data])
        agreement *= ROUGH_AGREEMENT if is_rough else 1.0
        rim = OpenBoundary.of(mesh)
        return cls(mesh.triangles, points, normals, faces, tree, rim, noise, agreement)

    def normalised(self, center: Array, size: float) -> "Surface":
        """Return the surface moved by -`center` (3,) and divided by `size`."""
        points = (self.points - center) / size
        return replace(
            self,
            triangles=(self.triangles - center) / size,
            points=points,
            tree=_tree(points),
            rim=self.rim.moved(center, size),
            noise=self.noise / size,
        )

    def with_walls(self, reach: float) -> "Surface":
        """Return the surface with the normals of samples within `reach` of its rim turned outward.

        The samples move onto the rim, as if it had thickness: the normals of a flat sheet do not
        determine the position of the sheet in its plane.
        """
        if self.rim.tree is None:
            return self
        found = self.rim.tree.query(self.points, distance_upper_bound=reach)
        distance, index = (np.asarray(part) for part in found)
        near = np.isfinite(distance)
        points, normals, faces = self.points.copy(), self.normals.copy(), self.faces.copy()
        points[near] = self.rim.points[index[near]]
        normals[near] = self.rim.outward[index[near]]
        faces[near] = self.faces[self.nearest(points[near])]
        return replace(self, points=points, normals=normals, faces=faces, tree=_tree(points))

    @property
    def spacing(self) -> float:
        """Spacing of the samples: the square root of the area per sample."""
        edges = np.diff(self.triangles, axis=1)
        area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
        return float(np.sqrt(area / len(self.points)))

    def nearest(self, points: Array) -> Indices:
        """Return the index (...) of the sample nearest to each of `points` (..., 3)."""
        return np.asarray(self.tree.query(points)[1])

    def within(self, points: Array, reach: float) -> tuple[Array, Indices]:
        """Return distance and index (...) of the sample nearest to `points` (..., 3) in `reach`.

        Without such a sample the distance is inf and the index 0, at almost no cost.
        """
        distance, index = self.tree.query(points, distance_upper_bound=reach)
        found = np.isfinite(distance)
        return np.asarray(distance), np.where(found, index, 0)

    def distances(
        self, points: Array, num_nearest: int = 3, reach: float = np.inf
    ) -> tuple[Array, Array]:
        """Return the distance (n,) of `points` (n, 3) to the surface, and its unit normal (n, 3).

        The triangles of the `num_nearest` nearest samples are tried: the distance is exact if the
        nearest triangle is among them, otherwise too long by far less than the sample spacing.
        Points without a sample within `reach` get the distance `reach` and an arbitrary normal.
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


def _tree(points: Array) -> KDTree:
    # For many short searches in a small cloud, tight boxes around nodes do not pay.
    return KDTree(points, leafsize=24, compact_nodes=False, balanced_tree=False)


def _smoothed(tree: KDTree, normals: Array, passes: int) -> Array:
    index = np.asarray(tree.query(tree.data, k=NUM_SMOOTHED)[1])
    for _ in range(passes):
        neighbors = normals[index]  # (m, k, 3)
        alike = np.einsum("mkd,md->mk", neighbors, normals) > SAME_SIDE_COSINE
        normals = unit(np.einsum("mkd,mk->md", neighbors, alike.astype(np.float64)))
    return normals


def _noise(near: Array, normals: Array, distance: Array) -> tuple[float, float]:
    """Return the noise of samples, in their unit, and its ratio to the neighbours' distance.

    The median, over p places, of the residual of a quadratic surface fitted to the k neighbours:
    the fit removes curvature, the median removes edges, and weights remove the other face of a
    thin wall. `near`, `normals`: (p, k, 3) neighbours relative to each place, nearest first;
    `distance`: (p, k).
    """
    alike = np.einsum("pkd,pd->pk", normals, normals[:, 0]) > 0.0
    frame = basis_from_direction(np.einsum("pkd,pk->pd", normals, alike.astype(np.float64)))
    reach = np.maximum(distance[:, -1:], 1e-12)
    height, x, y = np.moveaxis(near @ frame, -1, 0) / reach
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    # The nearest samples are on the same face; others join if they continue the fit.
    weight = alike * (np.arange(near.shape[1]) < NUM_NEAREST)
    left = height
    for count in (3, 6, 6):  # terms: a plane first
        used = terms[..., :count]
        weighted = np.swapaxes(used * weight[..., None], 1, 2)
        system = weighted @ used + 1e-9 * np.eye(count)
        fitted = (used @ np.linalg.solve(system, weighted @ height[..., None]))[..., 0]
        left = height - fitted
        spread = np.nanmedian(np.where(weight > 0.0, np.abs(left), np.nan), axis=1)
        scale = np.maximum(TUKEY * spread, 1e-9)[:, None]
        weight = alike * np.square(np.clip(1.0 - np.square(left / scale), 0.0, None))
    kept = weight > 0.0
    freedom = np.maximum(kept.sum(axis=1) - terms.shape[-1], 1)
    slope = np.sqrt((np.square(left) * kept).sum(axis=1) / freedom)
    return float(np.median(slope * reach[:, 0])), float(np.median(slope))


def _agreement(neighbors: Array, normals: Array) -> float:
    """Return the share of `neighbors` (p, k, 3) whose normals agree with `normals` (p, 3)."""
    if not neighbors.size:
        return 1.0
    cosine = np.abs(np.einsum("pkd,pd->pk", neighbors, normals))
    return float(np.mean(cosine > AGREEING_COSINE))
