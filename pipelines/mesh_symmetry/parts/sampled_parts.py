"""Parts of a surface as sets of its samples: neighbours, clusters, triangles of a part.

Samples are linked by distance instead of by the mesh's edges, so that cracks, touching patches and
double walls do not separate them, and the tessellation does not matter.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from pipelines.array_types import Indices, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.mesh_symmetry.surface.sampled_surface import Surface

LINK = 3.0  # of the spacing of the samples: about 28 neighbours
NO_EDGE = float(np.cos(np.radians(25.0)))  # between the normals of linked samples
NO_PART = -1


@dataclass(frozen=True)
class SampledParts:
    """Evenly spread surface samples of `mesh`."""

    mesh: Mesh
    surface: Surface

    @classmethod
    def of(cls, mesh: Mesh, num_samples: int, rng: np.random.Generator) -> "SampledParts":
        """Draw the samples, evenly by area."""
        return cls(mesh, Surface.from_mesh(mesh, num_samples, rng))

    @cached_property
    def beside(self) -> csr_matrix:
        """Graph (m, m) of neighbouring samples, built when it is first used."""
        count = len(self.surface.points)
        reach = LINK * float(np.sqrt(self.mesh.area / count))
        first, second = self.surface.tree.query_pairs(reach, output_type="ndarray").T
        links = np.ones(2 * len(first), dtype=np.float32)
        rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
        return coo_matrix((links, (rows, columns)), shape=(count, count)).tocsr()

    def clusters(self, members: Mask, same_side: float | None = None) -> list[Mask]:
        """Return the connected sets of `members` (m,), largest first.

        With `same_side`, links count only between normals of at least this cosine.
        """
        index = np.flatnonzero(members)
        graph = self.beside[index][:, index].tocoo()
        rows, columns = graph.row, graph.col
        if same_side is not None:
            normals = self.surface.normals[index]
            alike = np.einsum("ld,ld->l", normals[rows], normals[columns]) >= same_side
            rows, columns = rows[alike], columns[alike]
        links = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=graph.shape)
        label = connected_components(links, directed=False)[1]
        order = np.argsort(-np.bincount(label), kind="stable")
        masks = np.zeros((len(order), len(members)), dtype=np.bool_)
        masks[np.argsort(order)[label], index] = True
        return list(masks)

    def smoothed(self, members: Mask) -> Mask:
        """Return `members` (m,) by majority vote among each sample's neighbours."""
        degree = np.asarray(self.beside.sum(axis=1)).reshape(-1)
        agreeing = self.beside @ members.astype(np.float64)
        return np.asarray(agreeing + members > 0.5 * (degree + 1))

    def touching(self, members: Mask, other: Mask) -> float:
        """Return the number of links between the samples `members` and `other`, both (m,)."""
        return float((self.beside[members] @ other.astype(np.float64)).sum())

    def smooth_border(self, members: Mask) -> float:
        """Return the share of the links out of `members` (m,) without an edge; 0 without links."""
        links = self.beside[members].tocoo()
        inside, outside = np.flatnonzero(members)[links.row], links.col
        inside, outside = inside[~members[outside]], outside[~members[outside]]
        if not len(inside):
            return 0.0
        normals = self.surface.normals
        cosine = np.abs(np.einsum("ld,ld->l", normals[inside], normals[outside]))
        return float(np.mean(cosine > NO_EDGE))

    def owner_of_faces(self, owner: Indices) -> Indices:
        """Return the part (f,) of each triangle, given the part `owner` (m,) of each sample.

        A triangle has the part of most of its samples; without samples, the nearest sample's part.
        """
        parts = int(owner.max(initial=NO_PART)) + 2
        votes = np.zeros((len(self.mesh.faces), parts), dtype=np.int64)
        np.add.at(votes, (self.surface.faces, owner + 1), 1)
        nearest = owner[self.surface.nearest(self.mesh.triangles.mean(axis=1))]
        voted = votes.argmax(axis=1) - 1
        return np.where(votes.sum(axis=1) > 0, voted, nearest)

    def on_triangles(self, members: Mask) -> Mask:
        """Return the samples (m,) on the triangles that the samples `members` (m,) represent."""
        return np.asarray(self._triangles_of(members)[self.surface.faces])

    def submesh(self, members: Mask) -> Mesh:
        """Return the mesh of the triangles that the samples `members` (m,) represent."""
        return self.mesh.submesh(self._triangles_of(members))

    def _triangles_of(self, members: Mask) -> Mask:
        return np.asarray(self.owner_of_faces(np.where(members, 0, NO_PART)) == 0)
