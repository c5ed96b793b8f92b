"""Crossings of straight lines with the surface of a mesh, in order along each line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.rendering import first_hits

STEP_PAST = 1e-6  # metres behind a crossing where the search continues
MAX_CROSSINGS = 64  # of one line; graspable objects have far fewer


@dataclass(frozen=True)
class Crossings:
    """Crossings of lines with a surface, nearest first."""

    distance: Array  # (n, k) metres from each line's start, ascending; inf after the last
    # (n, k) between the line and the outward normal: positive where the line leaves the
    # object, negative where the line enters; 0 after the last crossing
    cosine: Array

    def __getitem__(self, index: Mask | np.bool_) -> "Crossings":
        distance = self.distance[index]
        used = int(np.isfinite(distance).any(axis=0).sum())
        return Crossings(distance[:, :used], self.cosine[index][:, :used])

    @property
    def count(self) -> NDArray[np.int64]:
        """(n,) number of crossings of each line."""
        return np.asarray(np.isfinite(self.distance).sum(axis=1))

    @property
    def leave(self) -> Mask:
        """(n, k) whether the line leaves the object at the crossing."""
        return np.asarray(self.cosine > 0.0)


def line_crossings(mesh: Mesh, start: Array, direction: Array, reach: float) -> Crossings:
    """Return all crossings of lines with `mesh` up to `reach` metres from their start.

    `start` (n, 3) metres and unit `direction` (n, 3), the mesh's frame.
    """
    columns: list[tuple[Array, Array]] = []
    line = np.arange(len(start))
    travelled = np.zeros(len(start))
    last = np.full(len(start), -1)
    for _ in range(MAX_CROSSINGS):
        at = start[line] + travelled[:, None] * direction[line]
        ahead, triangle = first_hits(mesh, at, direction[line])
        travelled = travelled + ahead
        hit = travelled <= reach
        if not hit.any():
            break
        line, travelled, triangle, last = line[hit], travelled[hit], triangle[hit], last[hit]
        # In single precision, a ray may hit the triangle that it has just passed again.
        new = triangle != last
        found, cosine = np.full(len(start), np.inf), np.zeros(len(start))
        found[line[new]] = travelled[new]
        normals = mesh.face_normals[triangle[new]]
        cosine[line[new]] = np.einsum("ni,ni->n", direction[line[new]], normals)
        columns.append((found, cosine))
        last, travelled = triangle, travelled + STEP_PAST
    both = np.reshape(columns, (len(columns), 2, len(start))).transpose(1, 2, 0)
    order = np.argsort(both[0], axis=1, kind="stable")  # close the gaps of repeated triangles
    crossings = Crossings(*(np.take_along_axis(each, order, axis=1) for each in both))
    return crossings[np.ones(len(start), np.bool_)]
