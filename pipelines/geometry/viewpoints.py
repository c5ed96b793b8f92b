"""Viewpoints from which a person sees whether an object's symmetries are right."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.directions import sphere_directions
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.geometry.transforms import make_pose, unit

NUM_CANDIDATES = 240  # compared directions
VIEW_STEP = np.pi * (1.0 + np.sqrt(5.0))  # radians; the negative golden angle and two turns
FIELD = np.radians(9.0)  # field of view; with a long lens, parallels stay parallel
PICTURE_MARGIN = 1.22  # width of the picture over the width of the object
OBLIQUE_COSINE = 0.5  # between the view and a normal or axis: neither hidden nor flat
AREA_WEIGHT, TOP_WEIGHT = 0.6, 0.2  # of shown area and of height; obliqueness has weight 1
UP_SINE = 1e-3  # between the view and up, below which another direction is up
UP_COSINE = 0.7  # between a normal and an axis, below which the normal may be up
SQUARE_COSINE = 0.05  # between a view and a normal: the plane is edge on
SAME_NORMAL_COSINE = float(np.cos(np.radians(3.0)))
UP = np.array([0.0, 0.0, 1.0])


def camera(size: int) -> Intrinsics:
    """Return the intrinsics of a square picture of `size` pixels."""
    focal = 0.5 * size / np.tan(0.5 * FIELD)
    return Intrinsics(focal, focal, 0.5 * (size - 1), 0.5 * (size - 1), size, size)


def view_along(mesh: Mesh, direction: Array, up: Array) -> Array:
    """Return `T_mesh_cam` (4, 4) of a camera that sees all of `mesh` along `direction` (3,).

    `up`: (3,) mesh frame, the top of the picture.
    """
    forward = unit(direction)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < UP_SINE:
        right = np.cross(forward, np.eye(3)[np.abs(forward).argmin()])
    right = unit(right)
    axes = np.stack([right, np.cross(forward, right), forward], axis=1)
    seen = mesh.vertices[np.unique(mesh.faces)] @ axes
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    # The nearest point of the view axis from which all vertices are inside the picture.
    across = np.abs(seen[:, :2] - middle[:2]).max(axis=1)
    distance = (PICTURE_MARGIN * across / np.tan(0.5 * FIELD) + middle[2] - seen[:, 2]).max()
    eye = np.array([middle[0], middle[1], middle[2] - distance])
    return make_pose(axes, axes @ eye)


def oblique_view(mesh: Mesh, symmetries: Sequence[Symmetry]) -> Array:
    """Return `T_mesh_cam` (4, 4) of a view oblique to all planes and axes, large and from above."""
    towards = -sphere_directions(NUM_CANDIDATES, VIEW_STEP, first=0.5)
    special = [s.direction for s in symmetries if not isinstance(s, SphereSymmetry)]
    axes = np.stack(special) if special else _principal_axes(mesh)
    cosine = np.abs(towards @ axes.T)
    slant = 1.0 - (np.abs(cosine - OBLIQUE_COSINE) / OBLIQUE_COSINE).max(axis=1)
    area = np.abs(towards @ mesh.face_normals.T) @ mesh.face_areas
    score = slant + AREA_WEIGHT * area / area.max() - TOP_WEIGHT * towards[:, 2]
    return view_along(mesh, towards[int(score.argmax())], UP)


def symmetry_view(mesh: Mesh, symmetries: Sequence[Symmetry]) -> Array:
    """Return `T_mesh_cam` (4, 4) of the view in which a person checks the symmetries best.

    The view is along an axis, where a round object looks round; else along the planes, where left
    mirrors right; else opposite to the oblique view.
    """
    normals = _distinct([s.normal for s in symmetries if isinstance(s, ReflectionSymmetry)])
    axes = [s for s in symmetries if isinstance(s, RotationSymmetry)]
    turning = [s.axis for s in axes if s.order != 2]
    if turning:
        up = normals[0] if normals and abs(normals[0] @ turning[0]) < UP_COSINE else UP
        return _down_line(mesh, turning[0], up)
    if len(normals) > 1:
        return _along_planes(mesh, normals)
    if normals:
        return _along_plane(mesh, normals[0])
    if axes:
        return _down_line(mesh, axes[0].axis, UP)
    oblique = oblique_view(mesh, symmetries)
    return view_along(mesh, -oblique[:3, 2], UP)


def _down_line(mesh: Mesh, line: Array, up: Array) -> Array:
    """Return the view along `line` (3,), in the direction that leads down."""
    return view_along(mesh, -line if line[2] > 0 else line, up)


def _distinct(normals: Sequence[Array]) -> list[Array]:
    """Return one normal per set of parallel planes, since parts of an object may share a plane."""
    kept: list[Array] = []
    for normal in normals:
        if all(abs(normal @ other) < SAME_NORMAL_COSINE for other in kept):
            kept.append(normal)
    return kept


def _along_planes(mesh: Mesh, normals: Sequence[Array]) -> Array:
    """Return the view that shows most of the object, along two planes or square to one of two."""
    crossings = [unit(np.cross(a, b)) for a, b in combinations(normals, 2)]
    # A view along a normal may show another plane edge on.
    square = [n for n in normals if any(abs(n @ other) < SQUARE_COSINE for other in normals)]
    lines = crossings + square
    best = max(lines, key=lambda line: float(np.abs(mesh.face_normals @ line) @ mesh.face_areas))
    up = max((np.cross(best, n) for n in normals), key=lambda v: float(v @ v))
    return _down_line(mesh, best, up)


def _along_plane(mesh: Mesh, normal: Array) -> Array:
    """Return the view along the plane of `normal` (3,) that shows most of the object."""
    towards = sphere_directions(NUM_CANDIDATES, VIEW_STEP, first=0.5)
    towards = unit(towards - (towards @ normal)[:, None] * normal)
    area = np.abs(towards @ mesh.face_normals.T) @ mesh.face_areas
    best = towards[int((area / area.max() - TOP_WEIGHT * towards[:, 2]).argmax())]
    up = np.cross(normal, best)
    return view_along(mesh, best, up if up[2] >= 0 else -up)


def _principal_axes(mesh: Mesh) -> Array:
    """Return the three principal axes of the surface, as rows."""
    centers = mesh.triangles.mean(axis=1)
    middle = np.average(centers, axis=0, weights=mesh.face_areas)
    arm = centers - middle
    return np.asarray(np.linalg.eigh((arm * mesh.face_areas[:, None]).T @ arm)[1].T)
