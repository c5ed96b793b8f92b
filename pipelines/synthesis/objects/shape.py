"""Shapes: solids with symmetries that are exact by construction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.geometry.transforms import make_pose
from pipelines.synthesis.objects.solids import Solid

Rng = np.random.Generator

ORIGIN = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid and its symmetries, in one frame; metres."""

    solid: Solid
    symmetries: tuple[Symmetry, ...] = ()

    def centered(self) -> "Shape":
        """Return the shape with the centre of its bounding box at the origin."""
        box = np.array(self.solid.body.bounding_box()).reshape(2, 3)
        shift = -box.mean(axis=0)
        T = make_pose(np.eye(3), shift)
        moved = tuple(symmetry.transformed(T) for symmetry in self.symmetries)
        return Shape(self.solid.moved(translation=shift), moved)


def mirror_planes(*normals: ArrayLike) -> tuple[Symmetry, ...]:
    """Return mirror symmetries in planes through the origin."""
    return tuple(ReflectionSymmetry(np.asarray(normal, float), ORIGIN) for normal in normals)


def mirror_axes(names: str) -> tuple[Symmetry, ...]:
    """Return mirror symmetries across the axes in `names`, e.g. "xy"."""
    return mirror_planes(*(np.eye(3)["xyz".index(name)] for name in names))


def revolution(level: bool = False) -> tuple[Symmetry, ...]:
    """Return rotation about the z axis; if `level`, also the mirror symmetry in z = 0."""
    axis: tuple[Symmetry, ...] = (RotationSymmetry(np.array([0.0, 0.0, 1.0]), ORIGIN),)
    return axis + (mirror_axes("z") if level else ())


def polygon_symmetries(order: int, level: bool = False) -> tuple[Symmetry, ...]:
    """Return the symmetries of a regular n-gon whose first corner is at +x, extruded along z."""
    angles = np.arange(order) * np.pi / order + np.pi / 2.0
    planes = mirror_planes(*np.column_stack([np.cos(angles), np.sin(angles), np.zeros(order)]))
    axis: tuple[Symmetry, ...] = (RotationSymmetry(np.array([0.0, 0.0, 1.0]), ORIGIN, order),)
    return planes + axis + (mirror_axes("z") if level else ())


def sphere(error: float = 0.0) -> tuple[Symmetry, ...]:
    """Return the symmetry of a ball about the origin; `error` as a share of its size."""
    return (SphereSymmetry(ORIGIN, error),)
