"""The rotations that follow from symmetries: turns and mirrors compose, two mirrors make a turn."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.geometry.transforms import basis_from_direction, make_pose, rotation_about

MAX_ELEMENTS = 120  # of a finite group of turns and mirrors of a solid: the icosahedron's
MAX_ORDER = 12
MEANT = 0.1  # of a share of a turn: an angle nearer to it is meant to be it
SAME_ANGLE = float(np.radians(4.0))  # elements closer than this are one
PARALLEL_COSINE = float(np.cos(np.radians(5.0)))


@dataclass(frozen=True)
class Rotations:
    """Proper rotations that leave an object as it is, its own frame, metres.

    Attributes:
        discrete: (k, 4, 4) rigid transforms, the identity left out; with `continuous`, those that
            its turns do not reach.
        continuous: axes about which any turn does; three through the centre of a sphere.
    """

    discrete: Array
    continuous: tuple[RotationSymmetry, ...] = ()


def implied_rotations(symmetries: Sequence[Symmetry]) -> Rotations:
    """Return every rotation that follows from `symmetries`, never a reflection."""
    nothing = np.zeros((0, 4, 4))
    spheres = [s for s in symmetries if isinstance(s, SphereSymmetry)]
    if spheres:
        axes = tuple(RotationSymmetry(axis, spheres[0].point) for axis in np.eye(3))
        return Rotations(nothing, axes)
    rounds = [s for s in symmetries if isinstance(s, RotationSymmetry) and s.order is None]
    if rounds:
        flip = _flip(rounds[0], symmetries)
        return Rotations(nothing if flip is None else flip[None], (rounds[0],))
    generators = [_transform(symmetry) for symmetry in symmetries]
    group = _closure(generators)
    if group is None:  # mirrors at odd angles are no group; each axis still has its own turns
        turns = [s for s in symmetries if isinstance(s, RotationSymmetry)]
        group = [g for turn in turns for g in _closure([_transform(turn)]) or []]
    proper = [turn_of(g) for g in group if np.linalg.det(g[:3, :3]) > 0]
    found = [_matrix(axis, angle, point) for axis, angle, point in proper if angle > SAME_ANGLE]
    return Rotations(np.array(found).reshape(-1, 4, 4))


def turn_of(transform: Array) -> tuple[Array, float, Array]:
    """Return axis (3,), angle (0 to pi) and a point (3,) of the axis of a rigid (4, 4) rotation.

    The angle is taken as the share of a full turn that it is meant to be, if it is one nearly.
    """
    R, t = transform[:3, :3], transform[:3, 3]
    angle = float(np.arccos(np.clip((np.trace(R) - 1.0) / 2.0, -1.0, 1.0)))
    # The axis is what R leaves in place: the eigenvector of R + R^T of the largest eigenvalue.
    axis = np.linalg.eigh(R + R.T)[1][:, 2]
    sense = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    axis = -axis if axis @ sense < -1e-12 else axis
    point = np.linalg.lstsq(np.eye(3) - R, t - (t @ axis) * axis, rcond=1e-6)[0]
    shares = 2.0 * np.pi / np.arange(2, MAX_ORDER + 1)
    meant = np.rint(angle / shares) * shares
    nearest = int(np.abs(meant - angle).round(9).argmin())
    is_meant = abs(meant[nearest] - angle) < min(SAME_ANGLE, MEANT * shares[nearest])
    return axis, float(meant[nearest]) if is_meant else angle, point


def _matrix(axis: Array, angle: float, point: Array) -> Array:
    R = rotation_about(axis, angle)
    return make_pose(R, point - R @ point)


def _transform(symmetry: Symmetry) -> Array:
    """Return the (4, 4) map of a mirror or of the smallest turn of an n-fold axis."""
    if isinstance(symmetry, RotationSymmetry) and symmetry.order is not None:
        return _matrix(symmetry.axis, 2.0 * np.pi / symmetry.order, symmetry.point)
    n = symmetry.direction
    return make_pose(np.eye(3) - 2.0 * np.outer(n, n), 2.0 * (symmetry.point @ n) * n)


def _closure(generators: Sequence[Array]) -> list[Array] | None:
    """Return the group that (4, 4) maps generate; None if it has too many elements to be one.

    Elements are made of as few factors as possible, so errors of the generators add up least.
    """
    group, frontier = [np.eye(4)], [np.eye(4)]
    while frontier:
        fresh: list[Array] = []
        for element in frontier:
            for generator in generators:
                product = generator @ element
                if not any(_same(product, known) for known in group):
                    group.append(product)
                    fresh.append(product)
            if len(group) > MAX_ELEMENTS:
                return None
        frontier = fresh
    return group


def _same(first: Array, second: Array) -> bool:
    between = first[:3, :3].T @ second[:3, :3]
    if np.linalg.det(between) < 0:
        return False
    return bool((np.trace(between) - 1.0) / 2.0 > np.cos(SAME_ANGLE))


def _flip(axis: RotationSymmetry, symmetries: Sequence[Symmetry]) -> Array | None:
    """Return the half turn that swaps the two ends of a round `axis`, if there is one.

    A mirror across the axis and one through it, which what is round has, make it.
    """
    for symmetry in symmetries:
        if isinstance(symmetry, ReflectionSymmetry):
            slope = float(symmetry.normal @ axis.axis)
            if abs(slope) > PARALLEL_COSINE:
                gap = float((symmetry.point - axis.point) @ symmetry.normal)
                middle = axis.point + gap / slope * axis.axis
                return _matrix(basis_from_direction(axis.axis)[:, 1], np.pi, middle)
    return None
