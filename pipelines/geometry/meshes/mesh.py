"""Triangle meshes. Metres, the object's frame."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Array, Indices, Mask
from pipelines.errors import ValueRangeError
from pipelines.geometry.transforms import transform_points, unit


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh."""

    vertices: Array  # (v, 3) metres, finite
    faces: Indices  # (f, 3) indices into `vertices`, counter-clockwise seen from outside

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, np.float64).reshape(-1, 3)
        faces = np.asarray(self.faces, np.int64).reshape(-1, 3)
        if not len(faces):
            raise ValueRangeError("mesh", "without triangles", "a surface of at least one triangle")
        if not np.isfinite(vertices).all():
            raise ValueRangeError("mesh vertices", "not finite", "finite numbers, metres")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueRangeError("mesh faces", "beyond the vertices", f"0 to {len(vertices) - 1}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @cached_property
    def triangles(self) -> Array:
        """(f, 3, 3) metres, the corners of each triangle."""
        return self.vertices[self.faces]

    @cached_property
    def _crosses(self) -> Array:
        a, b, c = self.triangles.swapaxes(0, 1)
        return np.cross(b - a, c - a)

    @cached_property
    def face_normals(self) -> Array:
        """(f, 3) outward unit normals; zero for degenerate triangles."""
        return unit(self._crosses)

    @cached_property
    def face_areas(self) -> Array:
        """(f,) square metres."""
        return np.asarray(0.5 * np.linalg.norm(self._crosses, axis=1))

    @property
    def area(self) -> float:
        """Square metres."""
        return float(self.face_areas.sum())

    @property
    def bounds(self) -> Array:
        """(2, 3) metres, lowest and highest corner."""
        used = self.vertices[np.unique(self.faces)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, metres."""
        low, high = self.bounds
        return float(np.linalg.norm(high - low))

    @property
    def volume(self) -> float:
        """Signed enclosed volume in cubic metres; positive if faces turn outward."""
        a, b, c = self.triangles.swapaxes(0, 1)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    @property
    def is_watertight(self) -> bool:
        """Whether each edge has equally many triangles in both directions."""
        edges = self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        forward = edges[:, 0] * len(self.vertices) + edges[:, 1]
        backward = edges[:, 1] * len(self.vertices) + edges[:, 0]
        return bool(np.array_equal(np.sort(forward), np.sort(backward)))

    def transformed(self, T: ArrayLike) -> "Mesh":
        """Return the mesh moved by the (4, 4) transform `T`."""
        return replace(self, vertices=transform_points(T, self.vertices))

    def submesh(self, faces: NDArray[np.integer] | Mask) -> "Mesh":
        """Return the mesh of the triangles `faces`, indices (k,) or mask (f,); vertices stay."""
        return replace(self, faces=self.faces[faces])

    @classmethod
    def concatenate(cls, parts: "list[Mesh]") -> "Mesh":
        """Return all triangles of `parts` as one mesh."""
        starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
        return cls(
            np.concatenate([part.vertices for part in parts]),
            np.concatenate([part.faces + s for part, s in zip(parts, starts, strict=True)]),
        )


def sample_surface(
    mesh: Mesh, n: int, rng: np.random.Generator, density: Array | None = None
) -> tuple[Array, Array, Indices]:
    """Return `n` points of the surface, evenly spread by area times `density` (f,), if given.

    Returns:
        points (n, 3), outward unit normals (n, 3), and the triangle (n,) of each point.
    """
    cumulative = np.cumsum(mesh.face_areas if density is None else mesh.face_areas * density)
    # One draw in each of n equal shares of the area clumps less than independent draws.
    places = (np.arange(n) + rng.uniform(size=n)) / n * cumulative[-1]
    index = np.minimum(np.searchsorted(cumulative, places, side="right"), len(cumulative) - 1)
    u, v = rng.uniform(size=(2, n, 1))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    a, b, c = mesh.triangles[index].swapaxes(0, 1)
    return a + u * (b - a) + v * (c - a), mesh.face_normals[index], index
