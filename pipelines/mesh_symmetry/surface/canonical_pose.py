"""Canonical pose, size and triangle order of a mesh, for results independent of its file.

Samples, search directions and grids are laid out in the mesh's frame. In a frame fixed to the
surface, with triangles in an order fixed to it, the same surface gives the same samples and the
same symmetries, in any pose, unit and order of triangles.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, Symmetry

CELLS_PER_RADIUS = 8.0  # triangles are sorted by spatial cells, so that neighbours stay together


@dataclass(frozen=True)
class CanonicalPose:
    """A mesh moved to its canonical frame, x = rotation (x_given - center) / size."""

    mesh: Mesh  # in the canonical frame
    rotation: Array  # (3, 3)
    center: Array  # (3,) metres, frame of the given mesh
    size: float  # metres

    @classmethod
    def of(cls, given: Mesh) -> "CanonicalPose":
        """Return `given` with the centroid as origin, along its principal axes, at unit radius.

        Duplicate triangles are removed. A mesh without area is unchanged.
        """
        mesh = _without_doubles(given)
        area = mesh.face_areas
        if not area.sum() > 0.0:
            return cls(mesh, np.eye(3), np.zeros(3), 1.0)
        middle = mesh.triangles.mean(axis=1)
        center = np.average(middle, axis=0, weights=area)
        arms = mesh.triangles - center
        sums = arms.sum(axis=1)
        # The exact second moment of a triangle's area about the centroid.
        moment = np.einsum("f,fi,fj->ij", area, sums, sums)
        moment += np.einsum("f,fki,fkj->ij", area, arms, arms)
        moment /= 12.0 * area.sum()
        rotation = np.linalg.eigh(moment)[1].T[::-1].copy()
        lean = np.average(((middle - center) @ rotation.T) ** 3, axis=0, weights=area)
        rotation[lean < 0.0] *= -1.0  # the longer tail is on the positive side
        rotation[2] = np.cross(rotation[0], rotation[1])
        size = float(np.sqrt(np.trace(moment)))
        vertices = (mesh.vertices - center) @ rotation.T / size
        return cls(Mesh(vertices, _in_order(vertices, mesh.faces)), rotation, center, size)

    def posed(self, symmetry: Symmetry) -> Symmetry:
        """Return `symmetry` of the given mesh in the canonical frame."""
        point = self.rotation @ (symmetry.point - self.center) / self.size
        return _moved(symmetry, self.rotation, point)

    def given(self, symmetry: Symmetry) -> Symmetry:
        """Return `symmetry` of the canonical mesh in the frame of the given mesh."""
        point = self.center + self.size * symmetry.point @ self.rotation
        return _moved(symmetry, self.rotation.T, point)


def _moved(symmetry: Symmetry, rotation: Array, point: Array) -> Symmetry:
    """Return `symmetry` turned by `rotation` (3, 3) and moved to `point` (3,)."""
    match symmetry:
        case ReflectionSymmetry():
            return replace(symmetry, normal=rotation @ symmetry.normal, point=point)
        case RotationSymmetry():
            return replace(symmetry, axis=rotation @ symmetry.axis, point=point)
    return replace(symmetry, point=point)


def _without_doubles(mesh: Mesh) -> Mesh:
    number = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)
    corners = np.sort(number[mesh.faces], axis=1)
    kept = np.unique(corners, axis=0, return_index=True)[1]
    return mesh if len(kept) == len(mesh.faces) else mesh.submesh(np.sort(kept))


def _in_order(vertices: Array, faces: Indices) -> Indices:
    """Return `faces` (f, 3) sorted by position, each starting opposite to its longest edge.

    All triangles face away from the centroid, since files disagree on the outside.
    """
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normal, corners.sum(axis=1)) < 0.0
    faces = np.where(inward[:, None], faces[:, ::-1], faces)
    corners = vertices[faces]
    opposite = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1), axis=2)
    first = opposite.argmax(axis=1)
    rolled = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    middle = corners.mean(axis=1)
    cell = np.floor(middle * CELLS_PER_RADIUS)
    return np.asarray(rolled[np.lexsort((*middle.T, *cell.T))])
