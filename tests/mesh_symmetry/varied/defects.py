"""Defects of real objects: bent, dented, engraved, sewn together by a scanner, noisy, with holes.

A defect maps vertices (n, 3) to vertices; sizes are shares of the bounding box's diagonal.
The upright axis is z.
"""

from collections.abc import Sequence

import numpy as np
import trimesh

from pipelines.array_types import Array
from pipelines.geometry.meshes.mesh import Mesh

NOISE = 0.004  # standard deviation at each vertex
HOLE_SHARE = 0.12  # of the area
NOISY_FACES, HOLED_FACES = 4000, 6000  # coarser meshes are divided first


def size_of(points: Array) -> float:
    """Return the diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def bent(points: Array, sagitta: float, angle: float = 0.0) -> Array:
    """Return `points` bent to an arc of the given sagitta, towards `angle` about z."""
    height = points[:, 2]
    share = 2.0 * (height - height.min()) / max(float(np.ptp(height)), 1e-12) - 1.0
    shift = sagitta * size_of(points) * (2.0 / 3.0 - share**2)
    return points + shift[:, None] * np.array([np.cos(angle), np.sin(angle), 0.0])


def oval(points: Array, share: float, angle: float = 0.0) -> Array:
    """Return `points` stretched by `share` towards `angle`, and squeezed across it."""
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    stretch = np.outer(points @ along, along) - np.outer(points @ across, across)
    return points + share * stretch


def dented(points: Array, depth: float, rng: np.random.Generator, count: int = 3) -> Array:
    """Return `points` with round dents, towards the middle of the object."""
    size, middle = size_of(points), points.mean(axis=0)
    moved = points.copy()
    for place in points[rng.integers(len(points), size=count)]:
        reach = size * rng.uniform(0.07, 0.13)
        inside = np.clip(1.0 - np.sum((points - place) ** 2, axis=1) / reach**2, 0.0, None)
        inward = (middle - place) / max(float(np.linalg.norm(middle - place)), 1e-12)
        moved += depth * size * (inside**2)[:, None] * inward
    return moved


def engraved(points: Array, depth: float, rng: np.random.Generator) -> Array:
    """Return `points` with strokes like letters, pressed into a third of the side."""
    radius, angle, height = _cylinder(points)
    share = (height - height.min()) / max(float(np.ptp(height)), 1e-12)
    window = (np.abs(angle) < 1.1) & (share > 0.3) & (share < 0.75)
    column, row = np.floor((angle + 1.1) * 12).astype(int), np.floor(share * 40).astype(int)
    stroke = rng.random((64, 64)) < 0.45
    pressed = window & stroke[column % 64, row % 64] & (radius > 0.6 * radius.max())
    return _outward(points, -depth * size_of(points) * pressed)


def sewn(points: Array, step: float) -> Array:
    """Return `points` that grow outward once around, with a step where the scan closes."""
    radius, angle, _ = _cylinder(points)
    return _outward(points, step * size_of(points) * angle / (2.0 * np.pi) * (radius > 0.0))


def lipped(points: Array, height: float, rng: np.random.Generator) -> Array:
    """Return `points` with an uneven rim: slanted and wavy in the upper fifth."""
    _, angle, z = _cylinder(points)
    share = np.clip((z - z.min()) / max(float(np.ptp(z)), 1e-12) * 5.0 - 4.0, 0.0, 1.0)
    start, waves = rng.uniform(0.0, 2.0 * np.pi), int(rng.integers(2, 5))
    wave = 0.6 * np.cos(angle + start) + 0.4 * np.cos(waves * angle)
    moved = points.copy()
    moved[:, 2] += height * size_of(points) * share * wave
    return moved


def lumpy(points: Array, height: float, rng: np.random.Generator) -> Array:
    """Return `points` with low bumps all over, like fruit."""
    size, middle = size_of(points), points.mean(axis=0)
    arm = points - middle
    outward = arm / np.maximum(np.linalg.norm(arm, axis=1), 1e-12)[:, None]
    waves = rng.normal(size=(6, 3)) * 3.0
    bump = np.cos(outward @ waves.T + rng.uniform(0.0, 6.3, size=6)).sum(axis=1) / np.sqrt(3.0)
    return points + height * size * bump[:, None] * outward


def rough(points: Array, height: float, rng: np.random.Generator) -> Array:
    """Return `points` with the small bumps of a hand-held scan."""
    size = size_of(points)
    waves = rng.normal(size=(40, 3)) / (0.02 * size)
    phases = rng.uniform(0.0, 2.0 * np.pi, size=40)
    shifts = rng.normal(size=(40, 3)) / np.sqrt(20.0)
    return points + height * size * np.cos(points @ waves.T + phases) @ shifts


def fluted(points: Array, depth: float, count: int) -> Array:
    """Return `points` with `count` shallow grooves along the side."""
    _, angle, _ = _cylinder(points)
    return _outward(points, depth * size_of(points) * np.cos(count * angle))


def noisy(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Return `mesh` with noise at every vertex."""
    mesh = _divided(mesh, NOISY_FACES)
    shift = rng.normal(size=mesh.vertices.shape) * NOISE * size_of(mesh.vertices)
    return Mesh(mesh.vertices + shift, mesh.faces)


def holed(
    mesh: Mesh,
    rng: np.random.Generator,
    feature: Array | None = None,
    images: Sequence[Array] = (),
) -> Mesh:
    """Return `mesh` without the surface around a random place.

    The place is in the half away from `feature`, which breaks some symmetries. The surface stays
    at `images` too, where each broken symmetry would need another such feature.
    """
    mesh = _divided(mesh, HOLED_FACES)
    centers, area = mesh.triangles.mean(axis=1), mesh.face_areas
    share = area / area.sum()
    if feature is not None:
        away = np.linalg.norm(centers - feature, axis=1)
        share = share * (away > np.average(away, weights=area))
        share /= share.sum()
    needed = [np.linalg.norm(centers - image, axis=1).argmin() for image in images]
    while True:
        place = centers[rng.choice(len(centers), p=share)]
        order = np.argsort(np.linalg.norm(centers - place, axis=1))
        cut = int(np.searchsorted(np.cumsum(area[order]), HOLE_SHARE * area.sum()))
        if not np.isin(needed, order[:cut]).any():
            return mesh.submesh(np.sort(order[cut:]))


def _divided(mesh: Mesh, faces: int) -> Mesh:
    made = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    while len(made.faces) < faces:
        made = made.subdivide()
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def _cylinder(points: Array) -> tuple[Array, Array, Array]:
    x, y, z = points.T
    return np.hypot(x, y), np.arctan2(y, x), z


def _outward(points: Array, shift: Array) -> Array:
    """Return `points` moved by `shift` (n,) away from the z axis; points on the axis stay."""
    radius = np.hypot(points[:, 0], points[:, 1])
    scale = np.where(radius > 1e-9, (radius + shift) / np.maximum(radius, 1e-9), 1.0)
    return points * np.column_stack([scale, scale, np.ones(len(points))])
