"""The surface of a mesh as something to measure distances to."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, KDTree, QhullError
from scipy.spatial.distance import cdist
from trimesh.triangles import closest_point

from pipelines.array_types import Array, Indices
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.transforms import basis_from_direction, unit
from pipelines.mesh_symmetry.detection.symmetry_candidates import fibonacci_directions
from pipelines.mesh_symmetry.parts.open_boundary import OpenBoundary

MAX_EXACT, CHUNK = 8000, 500  # points of which all pairs are measured, and rows at a time
NUM_SUPPORTS = 2000  # directions 2.5 degrees apart
MAX_PRODUCTS = 4_000_000  # numbers held at a time
NUM_SMOOTHED = 16  # samples that a normal is averaged over
SAME_SIDE_COSINE = 0.3  # the other faces of an edge and of a thin wall do not count
ROUGH_PASSES = 3  # of averaging, where noise has tilted the triangles
ROUGH_SLOPE = 0.03  # noise over the distance of the neighbours it is measured among
NUM_PROBES, NUM_NEIGHBOURS = 500, 40  # places where noise is measured, and samples around each
FAR_NEIGHBOURS = 24  # from here on neighbours are not averaged into the same normals
AGREEING_COSINE = 0.85  # of two normals: 32 degrees


@dataclass(frozen=True)
class Surface:
    """A triangle mesh with evenly spread surface samples and a tree over them.

    The normals are averaged over neighbours of the same side, for scans whose triangles are rough.

    `triangles`: (f, 3, 3), `points` and `normals`: (m, 3), `faces`: (m,) the triangle that each
    sample lies on; unit of the mesh, frame of the mesh. `rim` is where the surface ends.
    Samples rather than vertices are the base of every search, so the tessellation
    does not matter.
    """

    triangles: Array
    points: Array
    normals: Array
    faces: Indices
    tree: KDTree
    rim: OpenBoundary
    noise: float  # of samples about a smooth surface through their neighbours, one sigma
    steadiness: float  # share of neighbouring samples whose normals agree

    @classmethod
    def from_mesh(cls, mesh: Mesh, num_samples: int, rng: np.random.Generator) -> "Surface":
        """Sample `mesh` at `num_samples` points, uniform by area."""
        points, normals, faces = sample_surface(mesh, num_samples, rng)
        tree = _tree(points)
        data = np.arange(0, num_samples, max(1, num_samples // NUM_PROBES))
        found = tree.query(points[data], k=min(NUM_NEIGHBOURS, num_samples))
        distance, index = (np.asarray(part) for part in found)
        noise, slope = _noise(points[index] - points[data][:, None], normals[index], distance)
        passes = ROUGH_PASSES if slope > ROUGH_SLOPE else 1
        normals = _smoothed(tree, normals, passes)
        return cls(
            triangles=mesh.triangles,
            points=points,
            normals=normals,
            faces=faces,
            tree=tree,
            rim=OpenBoundary.of(mesh),
            noise=noise,
            steadiness=_agreement(normals[index[:, FAR_NEIGHBOURS:]], normals[data]),
        )

    def normalised(self, center: Array, size: float) -> "Surface":
        """Return the surface moved by -`center` (3,) and divided by `size`."""
        points = (self.points - center) / size
        return Surface(
            triangles=(self.triangles - center) / size,
            points=points,
            normals=self.normals,
            faces=self.faces,
            tree=_tree(points),
            rim=self.rim.moved(center, size),
            noise=self.noise / size,
            steadiness=self.steadiness,
        )

    def with_walls(self, reach: float) -> "Surface":
        """Return the surface with the samples within `reach` of its rim on it, looking out of it.

        As if the rim had thickness: normals of a flat sheet do not say where in its plane it ends.
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
        """How far samples lie apart: the root of the area that each stands for."""
        edges = np.diff(self.triangles, axis=1)
        area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
        return float(np.sqrt(area / len(self.points)))

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


def _tree(points: Array) -> KDTree:
    # Many short searches of a cloud that fits the cache: tight boxes about nodes cost more time
    # than they save, half of it and more.
    return KDTree(points, leafsize=24, compact_nodes=False, balanced_tree=False)


def _smoothed(tree: KDTree, normals: Array, passes: int) -> Array:
    index = np.asarray(tree.query(tree.data, k=NUM_SMOOTHED)[1])
    for _ in range(passes):
        neighbours = normals[index]  # (m, k, 3)
        alike = np.einsum("mkd,md->mk", neighbours, normals) > SAME_SIDE_COSINE
        normals = unit(np.einsum("mkd,mk->md", neighbours, alike.astype(np.float64)))
    return normals


def _noise(near: Array, normals: Array, distance: Array) -> tuple[float, float]:
    """Return the noise of samples, in their unit, and as a slope: over their neighbours' reach.

    The median, over many places, of what is left when a quadratic surface is fitted to the
    samples around: shape bends, so it is fitted; edges are few, so they do not count. `near`,
    `normals`: (p, k, 3) neighbours seen from each place, nearest first; `distance`: (p, k).
    """
    alike = np.einsum("pkd,pd->pk", normals, normals[:, 0]) > 0.0
    frame = basis_from_direction(np.einsum("pkd,pk->pd", normals, alike.astype(np.float64)))
    reach = np.maximum(distance[:, -1:], 1e-12)
    height, x, y = np.moveaxis(near @ frame, -1, 0) / reach
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    weighted = np.swapaxes(terms * alike[..., None], 1, 2)
    system = weighted @ terms + 1e-9 * np.eye(terms.shape[-1])
    left = height - (terms @ np.linalg.solve(system, weighted @ height[..., None]))[..., 0]
    freedom = np.maximum(alike.sum(axis=1) - terms.shape[-1], 1)
    slope = np.sqrt((np.square(left) * alike).sum(axis=1) / freedom)
    return float(np.median(slope * reach[:, 0])), float(np.median(slope))


def _agreement(neighbours: Array, normals: Array) -> float:
    """Return the share of `neighbours` (p, k, 3) whose normals agree with `normals` (p, 3)."""
    if not neighbours.size:
        return 1.0
    cosine = np.abs(np.einsum("pkd,pd->pk", neighbours, normals))
    return float(np.mean(cosine > AGREEING_COSINE))


def diameter(points: Array) -> float:
    """Return the largest distance between two of `points` (n, 3); it does not turn with them.

    Exact, but for thousands of points that all lie as far out as any, a finely tessellated ball:
    there it may be a thousandth short.
    """
    try:
        corners = points[ConvexHull(points, qhull_options="QJ").vertices]
    except QhullError:  # fewer than four points, or not a number of them
        corners = points
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    out = np.linalg.norm(corners - middle, axis=1)
    # What is nearer to the middle than this belongs to no pair farther apart than one known.
    known = _far_apart(corners, corners[out.argmax()])
    far = corners[out + out.max() >= (1.0 - 1e-9) * known]
    if len(far) > MAX_EXACT:
        far = _outermost(far)
    rows = (cdist(far[i : i + CHUNK], far[i:]).max() for i in range(0, len(far), CHUNK))
    return float(max(rows))


def _far_apart(points: Array, start: Array) -> float:
    """Return the distance of a far pair: that of going to the farthest again and again."""
    longest = 0.0
    while True:
        apart = np.linalg.norm(points - start, axis=1)
        index = int(apart.argmax())
        if not apart[index] > longest:
            return longest
        longest, start = float(apart[index]), points[index]


def _outermost(points: Array) -> Array:
    """Return those of `points` (n, 3) that lie outermost along any of many directions.

    A lone tip is outermost over a wide angle, so unlike in every n-th point it stays.
    """
    directions = fibonacci_directions(NUM_SUPPORTS)
    found: list[Indices] = []
    for some in np.array_split(directions, max(1, len(points) * NUM_SUPPORTS // MAX_PRODUCTS)):
        along = some @ points.T
        found += [along.argmax(axis=1), along.argmin(axis=1)]
    return points[np.unique(np.concatenate(found))]
