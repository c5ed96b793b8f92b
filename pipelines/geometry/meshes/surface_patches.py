"""Small patches of a mesh's surface, to find the triangles that may meet a box without trying all.

A patch is a group of neighbouring triangles with a point of the surface and the radius around that
point. The number of patches depends on the surface's area, not on its tessellation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import transform_points

AHEAD = ((1, 2), (2, 0), (0, 1))  # the two axes that follow each axis
PATCH_SIZE = 0.004  # metres, edge of the cells whose triangles are one patch
LONGEST_EDGE = 0.003  # metres; longer triangles are split, so that a patch stays small
PIECE_AREA = 0.25  # of the square of its longest edge, about
MAX_PIECES = 500_000  # about; a larger surface has larger patches
MAX_SPLITS = 200  # more rounds of halving than any mesh needs


@dataclass(frozen=True)
class SurfacePatches:
    """Patches of a surface; metres, one frame."""

    centers: Array  # (n, 3) a point of the surface in each patch
    radius: Array  # (n,) of the ball about the centre that contains the patch
    triangles: Array  # (t, 3, 3) of the mesh; a triangle may belong to several patches
    members: Indices  # (m,) indices of the patches' triangles, patch by patch
    start: Indices  # (n + 1,) patch i has `members[start[i]:start[i + 1]]`

    @classmethod
    def from_mesh(cls, mesh: Mesh) -> "SurfacePatches":
        """Cut the whole surface of `mesh` into patches."""
        scale = max(1.0, np.sqrt(mesh.area / (PIECE_AREA * LONGEST_EDGE**2 * MAX_PIECES)))
        pieces, owner = _split(mesh.triangles, scale * LONGEST_EDGE)
        middle = pieces.mean(axis=1)
        cell = np.floor(middle / (scale * PATCH_SIZE)).astype(np.int64)
        patch = np.unique(cell, axis=0, return_inverse=True)[1].reshape(-1)
        size = np.bincount(patch)
        mean = np.stack([np.bincount(patch, middle[:, i]) for i in range(3)], axis=1)
        off = np.linalg.norm(middle - (mean / size[:, None])[patch], axis=1)
        centers = middle[np.lexsort((off, patch))[np.cumsum(size) - size]]
        radius = np.zeros(len(size))
        apart = np.linalg.norm(pieces - centers[patch, None], axis=2).max(axis=1)
        np.maximum.at(radius, patch, apart)
        pairs = np.unique(np.stack([patch, owner], axis=1), axis=0)
        start = np.searchsorted(pairs[:, 0], np.arange(len(size) + 1))
        return cls(centers, radius, mesh.triangles, pairs[:, 1], start)

    @classmethod
    def concatenate(cls, parts: "Sequence[SurfacePatches]") -> "SurfacePatches":
        """Return all patches of `parts`, in order."""
        first = np.cumsum([0, *(len(part.triangles) for part in parts)])
        before = np.cumsum([0, *(len(part.members) for part in parts)])
        none = np.zeros(0, np.int64)
        members = [part.members + n for part, n in zip(parts, first, strict=False)]
        starts = [part.start[:-1] + n for part, n in zip(parts, before, strict=False)]
        return cls(
            np.concatenate([np.zeros((0, 3)), *(part.centers for part in parts)]),
            np.concatenate([np.zeros(0), *(part.radius for part in parts)]),
            np.concatenate([np.zeros((0, 3, 3)), *(part.triangles for part in parts)]),
            np.concatenate([none, *members]),
            np.concatenate([none, *starts, before[-1:]]),
        )

    def __len__(self) -> int:
        return len(self.centers)

    def transformed(self, T: ArrayLike) -> "SurfacePatches":
        """Return the patches moved by the (4, 4) transform `T`."""
        return replace(
            self,
            centers=transform_points(T, self.centers),
            triangles=transform_points(T, self.triangles),
        )

    def triangles_of(self, patch: Indices) -> tuple[Indices, Indices]:
        """Return all pairs of a row of `patch` (m,) and a triangle of that patch."""
        size = self.start[patch + 1] - self.start[patch]
        row = np.repeat(np.arange(len(patch)), size)
        within = np.arange(len(row)) - np.repeat(np.cumsum(size) - size, size)
        return row, self.members[self.start[patch][row] + within]


def _split(triangles: Array, longest: float) -> tuple[Array, Indices]:
    """Halve triangles (n, 3, 3) at their longest edge until none is longer than `longest`.

    Returns the pieces (m, 3, 3) and the triangle (m,) that contains each piece.
    """
    owner = np.arange(len(triangles))
    done, owners = [], []
    for _ in range(MAX_SPLITS):
        edges = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        small = edges.max(axis=1) <= longest
        done.append(triangles[small])
        owners.append(owner[small])
        triangles, owner, worst = triangles[~small], owner[~small], edges[~small].argmax(axis=1)
        if not len(triangles):
            break
        turn = (worst[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(triangles, turn[:, :, None], axis=1).swapaxes(0, 1)
        half = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, half, c], 1), np.stack([half, b, c], 1)])
        owner = np.concatenate([owner, owner])
    return np.concatenate([*done, triangles]), np.concatenate([*owners, owner])


def meet_boxes(triangles: Array, low: Array, high: Array) -> Mask:
    """Return (n,) whether each triangle meets the inside of its box, exactly, by separating axes.

    `triangles` (n, 3, 3); `low`, `high` (n, 3) corners of the axis-aligned boxes. A triangle that
    touches a box from outside does not meet it.
    """
    # A contiguous row for each coordinate takes a third of the time of rows of triangles.
    a, b, c = np.ascontiguousarray(np.moveaxis(triangles, 0, 2))
    lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    meet = ((lowest < high.T) & (highest > low.T)).all(axis=0)
    rest = np.flatnonzero(meet)
    half, middle = 0.5 * (high - low)[rest].T, 0.5 * (high + low)[rest].T
    corners = [np.take(corner, rest, axis=1) - middle for corner in (a, b, c)]
    edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]]
    normal = np.stack([edges[0][j] * edges[1][k] - edges[0][k] * edges[1][j] for j, k in AHEAD])
    apart = np.abs((normal * corners[0]).sum(axis=0)) >= (np.abs(normal) * half).sum(axis=0)
    for edge, start, opposite in zip(edges, corners, (corners[2], *corners[:2]), strict=True):
        for j, k in AHEAD:  # axis of the box x edge: both ends of the edge project to one point
            reach = half[j] * np.abs(edge[k]) + half[k] * np.abs(edge[j])
            one = edge[j] * start[k] - edge[k] * start[j]
            other = edge[j] * opposite[k] - edge[k] * opposite[j]
            beyond = (np.minimum(one, other) >= reach) | (np.maximum(one, other) <= -reach)
            apart |= beyond & (reach > 0.0)
    meet[rest] = ~apart
    return np.asarray(meet)
