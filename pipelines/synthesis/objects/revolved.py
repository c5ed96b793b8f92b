"""Solids of revolution about the z axis: lathes, vessels, pipes, rings. Metres."""

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices
from pipelines.synthesis.objects.solids import (
    Solid,
    layered,
    ring_faces,
    rounded_polyline,
    solid_of,
    tube_faces,
)

SEGMENTS = 72  # around the axis: at 4 cm radius, facets deviate by up to 0.04 mm from the circle
SECTORS = 12  # convex pieces around a hollow lathe

# The five neighbours in a ring of 4 * SECTORS points that a piece spans.
SPANS = (4 * np.arange(SECTORS)[:, None] + np.arange(5)) % (4 * SECTORS)


def lathe(profile: ArrayLike, segments: int = SEGMENTS, slabs: int = 4) -> Solid:
    """Return the solid of revolution of `profile` (k, 2): radius and height from axis to axis.

    The first and last point lie on the axis. The pieces are hulls of `slabs` layers, for solids
    without a cavity (see `hollow_lathe`).
    """
    p = np.asarray(profile, np.float64)
    vertices, faces = _revolved(p, segments)
    dense = np.concatenate([p, _resampled(p, np.linspace(0.0, 1.0, 48))])
    return layered(solid_of(vertices, faces, [_rings(dense, 24).reshape(-1, 3)]), 2, slabs)


def hollow_lathe(outer: ArrayLike, inner: ArrayLike, segments: int = SEGMENTS) -> Solid:
    """Return a vessel: profile `outer` (k, 2) from axis to rim, `inner` (m, 2) from rim to axis."""
    outside, inside = np.asarray(outer, np.float64), np.asarray(inner, np.float64)
    vertices, faces = _revolved(np.concatenate([outside, inside]), segments)
    level = inside[-1, 1]
    edge = np.interp(level, outside[:, 1], outside[:, 0])
    floor = np.concatenate([outside[outside[:, 1] < level], [(edge, level)]])
    bottom = _rings(floor, 4 * SECTORS).reshape(-1, 3)
    return solid_of(vertices, faces, [bottom, *_wall_pieces(outside, inside)])


def pipe(outer_radius: float, inner_radius: float, height: float, bevel: float) -> Solid:
    """Return a tube about the z axis, its centre at the origin."""
    h = height / 2.0
    corners = [(outer_radius, h), (inner_radius, h), (inner_radius, -h), (outer_radius, -h)]
    loop = rounded_polyline(np.array([*corners, corners[0], corners[1]]), bevel, 3)[1:-1]
    rings = _rings(loop, SEGMENTS)
    vertices, faces = rings.reshape(-1, 3), ring_faces(len(loop), SEGMENTS, closed=True)
    outside = np.array([[outer_radius, -h], [outer_radius, h]])
    inside = np.array([[inner_radius, h], [inner_radius, -h]])
    return solid_of(vertices, faces, _wall_pieces(outside, inside, bands=1))


def torus(radius: float, section: Array) -> Solid:
    """Return the ring of a closed convex `section` (k, 2) revolved at `radius` from the z axis."""
    loop = section + np.array([radius, 0.0])
    vertices, faces = _rings(loop, SEGMENTS).reshape(-1, 3), ring_faces(len(loop), SEGMENTS, True)
    coarse = _rings(loop, 4 * SECTORS)
    pieces = [coarse[:, span].reshape(-1, 3) for span in SPANS]
    return solid_of(vertices, faces, pieces)


def _rings(profile: Array, segments: int) -> Array:
    """Return the points (k, segments, 3) of each profile point turned about the z axis."""
    angle = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
    x, y = profile[:, :1] * np.cos(angle), profile[:, :1] * np.sin(angle)
    return np.stack([x, y, np.broadcast_to(profile[:, 1:], x.shape)], -1)


def _revolved(profile: Array, segments: int) -> tuple[Array, Indices]:
    """Return vertices and triangles for a profile whose first and last point are on the axis."""
    inner = profile[1:-1]
    vertices = np.concatenate(
        [_rings(inner, segments).reshape(-1, 3), [[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]]]
    )
    return vertices, tube_faces(len(inner), segments)


def _wall_pieces(outside: Array, inside: Array, bands: int = 3) -> list[Array]:
    """Return convex pieces of the wall between an outer and an inner profile, above the floor."""
    heights = np.linspace(inside[:, 1].min() + 1e-6, inside[:, 1].max(), 3 * bands + 1)
    walls = [np.interp(heights, p[:, 1], p[:, 0]) for p in (outside, inside[::-1])]
    rings = np.stack([_rings(np.column_stack([r, heights]), 4 * SECTORS) for r in walls])
    bows = [rings[:, 3 * band : 3 * band + 4] for band in range(bands)]
    return [bow[:, :, span].reshape(-1, 3) for bow in bows for span in SPANS]


def _resampled(profile: Array, share: Array) -> Array:
    """Return the points of a profile at the given shares of its length."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    return np.column_stack([np.interp(share * length[-1], length, profile[:, i]) for i in (0, 1)])
