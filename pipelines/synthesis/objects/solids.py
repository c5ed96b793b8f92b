"""Closed solids as building blocks of objects: hulls, prisms, bent tubes, lumps, unions.

Unions and differences of a `Solid` are watertight; its convex pieces are for physics. Metres;
solids of revolution and prisms are along the z axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from manifold3d import CrossSection, Manifold, Mesh64
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, transform_points, unit

IDENTITY = np.eye(3)
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))  # (8, 3), of a cube
FLAT_FACES = 3000  # triangles of an object of flat faces, after splitting
MAX_FACES = 8000  # about; an object with more is split less


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed solid."""

    body: Manifold  # its surface
    pieces: tuple[Array, ...]  # (k, 3) points each; the union of their hulls approximates the solid

    def __or__(self, other: "Solid") -> "Solid":
        return Solid(self.body + other.body, self.pieces + other.pieces)

    def __sub__(self, other: "Solid") -> "Solid":
        """Cut `other` away; the pieces stay, so the cut must be negligible for physics."""
        return Solid(self.body - other.body, self.pieces)

    def moved(self, rotation: ArrayLike = IDENTITY, translation: ArrayLike = (0, 0, 0)) -> "Solid":
        """Return the solid turned (or mirrored) by `rotation` (3, 3), then moved, metres."""
        T = make_pose(rotation, translation)
        body = self.body.transform(np.ascontiguousarray(T[:3]))
        return Solid(body, tuple(transform_points(T, piece) for piece in self.pieces))

    def mesh(self) -> Mesh:
        """Return the surface with long edges split, up to about MAX_FACES triangles.

        Other toolkits read a model's vertices as its point cloud, so flat faces need vertices.
        """
        edge = float(np.sqrt(self.body.surface_area() / (0.3 * FLAT_FACES)))
        refined = self.body.refine_to_length(edge)
        while refined.num_tri() > max(MAX_FACES, self.body.num_tri()):
            edge *= 1.3
            refined = self.body.refine_to_length(edge)
        stored = refined.to_mesh64()
        vertices = np.asarray(stored.vert_properties)[:, :3]
        return Mesh(vertices, np.asarray(stored.tri_verts).astype(np.int64))


def solid_of(vertices: Array, faces: Indices, pieces: Sequence[Array]) -> Solid:
    """Return the solid bounded by a watertight surface of either orientation."""
    a, b, c = vertices[faces].swapaxes(0, 1)
    outward = np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    turned = faces if outward else faces[:, ::-1]
    body = Manifold(Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(turned, np.uint64)))
    return Solid(body, tuple(pieces))


def hull(points: Array) -> Solid:
    """Return the convex hull of `points` (n, 3)."""
    return Solid(Manifold.hull_points(np.ascontiguousarray(points)), (points,))


def box(size: ArrayLike, bevel: float = 0.0) -> Solid:
    """Return a box of `size` (3,) about the origin with edges bevelled by `bevel` metres."""
    half = np.asarray(size, np.float64) / 2.0
    if bevel <= 0.0:
        return hull(CORNERS * half)
    corners = [CORNERS * (half - bevel * (1.0 - np.eye(3)[axis])) for axis in range(3)]
    return hull(np.concatenate(corners))


def rounded_box(size: ArrayLike, radius: float) -> Solid:
    """Return a box of `size` (3,) about the origin with edges rounded by `radius` metres."""
    half = np.asarray(size, np.float64) / 2.0 - radius
    ball = _ball_directions() * radius
    return hull((CORNERS[:, None] * half + ball[None]).reshape(-1, 3))


def _ball_directions() -> Array:
    """Return unit vectors, symmetric in every coordinate plane."""
    grid = np.linspace(-1.0, 1.0, 8)
    x, y, z = np.meshgrid(grid, grid, grid)
    shell = np.stack([x, y, z], -1).reshape(-1, 3)
    return unit(shell[np.abs(shell).max(axis=1) > 1.0 - 1e-9])


def ball(radius: float, segments: int = 96) -> Solid:
    """Return a ball about the origin, made of 8 (segments / 4)^2 triangles."""
    body = Manifold.sphere(radius, segments)
    points = np.asarray(body.to_mesh64().vert_properties)[:, :3]
    return Solid(body, (points,))


def prism(outline: ArrayLike, height: float, pieces: Sequence[ArrayLike] | None = None) -> Solid:
    """Return the extrusion of `outline` (k, 2), counter-clockwise, centred on z = 0.

    `pieces`: convex outlines whose union is a concave `outline`.
    """
    o = np.asarray(outline, np.float64)
    body = Manifold.extrude(CrossSection([o]), height).translate((0.0, 0.0, -height / 2.0))
    flats = [o] if pieces is None else [np.asarray(piece, np.float64) for piece in pieces]
    return Solid(body, tuple(on_levels(flat, -height / 2.0, height / 2.0) for flat in flats))


def on_levels(outline: Array, first: float, second: float) -> Array:
    """Return the points (2 k, 3) of `outline` (k, 2) at two heights, metres."""
    heights = np.repeat([first, second], len(outline))
    return np.column_stack([np.tile(outline, (2, 1)), heights])


def bent_tube(path: Array, radii: ArrayLike, sides: int = 32, up: ArrayLike = (0, 0, 1)) -> Solid:
    """Return a tube along `path` (k, 3) with elliptic sections and pointed or blunt ends.

    `radii`: (k,) or (k, 2), metres, along up x tangent and along `up`, a direction to which the
    path is never parallel.
    """
    r = np.broadcast_to(np.asarray(radii, np.float64).reshape(len(path), -1), (len(path), 2))
    tangent = unit(np.gradient(path, axis=0))
    side = unit(np.cross(np.asarray(up, np.float64), tangent))
    above = np.cross(tangent, side)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    across = np.cos(angle)[None, :, None] * side[:, None] * r[:, None, :1]
    rings = path[:, None] + across + np.sin(angle)[None, :, None] * above[:, None] * r[:, None, 1:]
    vertices = np.concatenate([rings.reshape(-1, 3), path[[0, -1]]])
    cuts = np.linspace(0, len(path) - 1, min(9, len(path))).astype(int)
    pieces = [rings[a : b + 1].reshape(-1, 3) for a, b in pairwise(cuts)]
    return solid_of(vertices, tube_faces(len(path), sides), pieces)


def lump(
    radius: float,
    stretch: ArrayLike,
    waves: Sequence[tuple[Array, float, float]],
    segments: int = 72,
) -> Solid:
    """Return a ball of `radius`, dented by `waves` (direction, amplitude, phase), then stretched.

    Each wave adds amplitude * sin(direction . unit vector + phase) to the radius, as a share.
    """
    mesh = Manifold.sphere(1.0, segments).to_mesh64()
    directions = unit(np.asarray(mesh.vert_properties)[:, :3])
    height = np.ones(len(directions))
    for direction, amplitude, phase in waves:
        height += amplitude * np.sin(directions @ direction + phase)
    vertices = radius * directions * height[:, None] * np.asarray(stretch, np.float64)
    longest = int(np.argmax(np.ptp(vertices, axis=0)))
    solid = solid_of(vertices, np.asarray(mesh.tri_verts, np.int64), [vertices])
    return layered(solid, longest, 4)


def layered(solid: Solid, axis: int, count: int) -> Solid:
    """Return `solid` with its single piece cut into layers, unless it is nearly convex."""
    if solid.body.hull().volume() < 1.03 * solid.body.volume():
        return solid
    return Solid(solid.body, tuple(cut_layers(solid.pieces[0], axis, count)))


def cut_layers(points: Array, axis: int, count: int) -> list[Array]:
    """Cut `points` (n, 3) into `count` overlapping layers along `axis`, each spanning a volume."""
    low, high = points[:, axis].min(), points[:, axis].max()
    cuts = np.linspace(low, high, count + 1)
    slack = 0.12 * (high - low) / count
    inside = [
        points[(points[:, axis] >= a - slack) & (points[:, axis] <= b + slack)]
        for a, b in pairwise(cuts)
    ]
    return [part for part in inside if len(part) >= 8 and np.ptp(part, axis=0).min() > 1e-4]


def rounded_polyline(points: ArrayLike, radius: float, steps: int = 4) -> Array:
    """Return `points` (k, 2) with every inner corner replaced by an arc; the ends stay."""
    p = np.asarray(points, np.float64)
    result = [p[:1]]
    for before, corner, after in zip(p, p[1:], p[2:], strict=False):
        lengths = np.linalg.norm([before - corner, after - corner], axis=1)
        cut = min(radius, 0.45 * lengths.min())
        start, end = corner + cut * unit(before - corner), corner + cut * unit(after - corner)
        s = np.linspace(0.0, 1.0, steps)[:, None]
        # A quadratic Bezier curve approximates an arc and never overshoots.
        result.append((1 - s) ** 2 * start + 2 * s * (1 - s) * corner + s**2 * end)
    return np.concatenate([*result, p[-1:]])


def ring_faces(count: int, sides: int, closed: bool) -> Indices:
    """Return triangles that join `count` rings of `sides` vertices each."""
    steps = count if closed else count - 1
    ring, turn = np.meshgrid(np.arange(steps), np.arange(sides), indexing="ij")
    following, above = (turn + 1) % sides, (ring + 1) % count
    a, b = ring * sides + turn, ring * sides + following
    c, d = above * sides + following, above * sides + turn
    return np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)


def tube_faces(count: int, sides: int) -> Indices:
    """Return triangles of `count` rings of `sides` vertices each, closed by a fan at both ends.

    The middles of the first and the last fan are the two vertices after the rings' vertices.
    """
    turn = np.arange(sides)
    following, last = (turn + 1) % sides, (count - 1) * sides
    foot = np.full(sides, count * sides)
    fans = [
        np.stack([foot, following, turn], 1),
        np.stack([foot + 1, last + turn, last + following], 1),
    ]
    return np.concatenate([ring_faces(count, sides, closed=False), *fans])
