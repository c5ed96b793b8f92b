"""The three symmetries of the paper, and the network's five slots for them (Sec. III-E, Fig. 5)."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.array_types import Array, Indices
from pipelines.errors import ValueRangeError
from pipelines.geometry.transforms import rotate_vectors, rotation_about, transform_points

SymmetryKind = Literal["reflection", "rotation", "sphere"]
SYMMETRY_KINDS: tuple[SymmetryKind, ...] = ("reflection", "rotation", "sphere")
NUM_SLOTS = 5  # M of Eq. 7: three reflections, one rotation, one sphere
REFLECTION_SLOTS = (0, 1, 2)
ROTATION_SLOT = 3
SPHERE_SLOT = 4
KIND_OF_SLOT: tuple[SymmetryKind, ...] = (*("reflection",) * 3, "rotation", "sphere")
MAX_ORDER = 360  # for a gripper, repeats of less than a degree are continuous


def _checked_direction(name: str, vector: ArrayLike) -> Array:
    v = np.asarray(vector, np.float64)
    # A frame has hundreds of symmetries, and floats are faster than arrays of three.
    length = math.hypot(*v.tolist()) if v.shape == (3,) else 0.0
    if not 0.5 < length < 2.0:
        raise ValueRangeError(name, v.tolist(), "a unit vector of 3 finite numbers")
    return np.asarray(v / length)


def _checked_point(vector: ArrayLike) -> Array:
    v = np.asarray(vector, np.float64)
    if v.shape != (3,) or not all(map(math.isfinite, v.tolist())):
        raise ValueRangeError("point", v.tolist(), "3 finite numbers, metres")
    return v


@dataclass(frozen=True)
class ReflectionSymmetry:
    """Mirror symmetry in the plane through `point` (3,), metres, with unit `normal` (3,).

    `error`: dense symmetry error on the mesh where it was measured, else 0.
    """

    normal: Array
    point: Array
    error: float = 0.0
    kind = "reflection"

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", _checked_direction("normal", self.normal))
        object.__setattr__(self, "point", _checked_point(self.point))

    @property
    def direction(self) -> Array:
        """The plane's normal (3,), unit."""
        return self.normal

    def counterpart(self, points: ArrayLike) -> Array:
        """Return the mirror images (..., 3) of `points` (..., 3)."""
        p = np.asarray(points, np.float64)
        return np.asarray(p - 2.0 * ((p - self.point) @ self.normal)[..., None] * self.normal)

    def mirror_vectors(self, vectors: ArrayLike) -> Array:
        """Return the mirror images (..., 3) of free `vectors` (..., 3)."""
        v = np.asarray(vectors, np.float64)
        return np.asarray(v - 2.0 * (v @ self.normal)[..., None] * self.normal)

    def transformed(self, T: ArrayLike) -> "ReflectionSymmetry":
        """Return the symmetry of the object moved by the (4, 4) transform `T`."""
        return replace(
            self, normal=rotate_vectors(T, self.normal), point=transform_points(T, self.point)
        )


@dataclass(frozen=True)
class RotationSymmetry:
    """Rotation symmetry about the line through `point` (3,) along unit `axis` (3,).

    `order` is None for a continuous symmetry, n for a repetition every 1/n turn. `error`: as of a
    `ReflectionSymmetry`.
    """

    axis: Array
    point: Array
    order: int | None = None
    error: float = 0.0
    kind = "rotation"

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", _checked_direction("axis", self.axis))
        object.__setattr__(self, "point", _checked_point(self.point))
        if self.order is not None and not 2 <= self.order <= MAX_ORDER:
            raise ValueRangeError("order", self.order, f"None (continuous) or 2 to {MAX_ORDER}")

    @property
    def direction(self) -> Array:
        """The axis (3,), unit."""
        return self.axis

    def counterpart(self, points: ArrayLike) -> Array:
        """Return the points (..., 3) across the axis, the farthest on the orbits of `points`."""
        foot = np.asarray(points, np.float64) - self.point
        across = foot - (foot @ self.axis)[..., None] * self.axis
        return np.asarray(points, np.float64) - 2.0 * across

    def turn(self, points: ArrayLike, angle: ArrayLike) -> Array:
        """Return `points` (n, 3) turned by each `angle` (...), radians: (..., n, 3)."""
        R = rotation_about(self.axis, angle)
        turned = (np.asarray(points, np.float64) - self.point) @ np.swapaxes(R, -1, -2)
        return np.asarray(turned + self.point)

    def transformed(self, T: ArrayLike) -> "RotationSymmetry":
        """Return the symmetry of the object moved by the (4, 4) transform `T`."""
        return replace(
            self, axis=rotate_vectors(T, self.axis), point=transform_points(T, self.point)
        )


@dataclass(frozen=True)
class SphereSymmetry:
    """Symmetry under every rotation about `point` (3,), metres.

    `error`: measured on a mesh, mean distance from the sphere by its diameter, or the largest dense
    error of three axes; else 0.
    """

    point: Array
    error: float = 0.0
    kind = "sphere"

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _checked_point(self.point))

    @property
    def direction(self) -> Array:
        """(3,) nan: a sphere has no direction."""
        return np.full(3, np.nan)

    def counterpart(self, points: ArrayLike) -> Array:
        """Return the points (..., 3) opposite to `points` (..., 3) through the centre."""
        return 2.0 * self.point - np.asarray(points, np.float64)

    def transformed(self, T: ArrayLike) -> "SphereSymmetry":
        """Return the symmetry of the object moved by the (4, 4) transform `T`."""
        return replace(self, point=transform_points(T, self.point))


Symmetry = ReflectionSymmetry | RotationSymmetry | SphereSymmetry


@dataclass(frozen=True)
class ObjectRegion:
    """A region of an object: indices (k,) of its mesh's triangles, and symmetries, object frame."""

    name: str
    triangles: Indices
    symmetries: tuple[Symmetry, ...]


@dataclass(frozen=True)
class SymmetrySlots:
    """Symmetries as the network's five slots: 0-2 reflection, 3 rotation, 4 sphere."""

    # (5,) that the slot's symmetry is present, 0 to 1: the network's existence before the fit, the
    # confidence after the fit; 0 or 1 for ground truth
    probability: Array
    point: Array  # (5, 3) metres; nan where the slot is empty
    direction: Array  # (5, 3) unit; nan where the slot is empty, and for the sphere
    # (5,) source of the candidate: `network`, `shape` or `both`; empty if unknown
    source: NDArray[np.str_] = field(default_factory=lambda: np.full(NUM_SLOTS, "", "U7"))

    @classmethod
    def of(
        cls, symmetries: Iterable[tuple[int, Symmetry, float]], source: str = ""
    ) -> "SymmetrySlots":
        """Return the slots of `symmetries` (slot, symmetry, probability) from one `source`."""
        points, directions = np.full((2, NUM_SLOTS, 3), np.nan)
        slots = cls(np.zeros(NUM_SLOTS), points, directions, np.full(NUM_SLOTS, source, "U7"))
        for slot, symmetry, probability in symmetries:
            slots.probability[slot] = probability
            slots.point[slot], slots.direction[slot] = symmetry.point, symmetry.direction
        return slots

    @classmethod
    def from_symmetries(cls, symmetries: Iterable[Symmetry]) -> "SymmetrySlots":
        """Return the slots of `symmetries`: the first three planes, continuous axis, sphere.

        Discrete rotations have no slot; the paper's rotation is continuous.
        """
        placed: list[tuple[int, Symmetry]] = []
        planes = iter(REFLECTION_SLOTS)
        for symmetry in symmetries:
            match symmetry:
                case ReflectionSymmetry() if (slot := next(planes, None)) is not None:
                    placed.append((slot, symmetry))
                case RotationSymmetry(order=None):
                    placed.append((ROTATION_SLOT, symmetry))
                case SphereSymmetry():
                    placed.append((SPHERE_SLOT, symmetry))
        return cls.of((slot, symmetry, 1.0) for slot, symmetry in placed)

    def symmetry(self, slot: int) -> Symmetry:
        """Return the symmetry that the parameters of `slot` describe."""
        if slot in REFLECTION_SLOTS:
            return ReflectionSymmetry(self.direction[slot], self.point[slot])
        if slot == ROTATION_SLOT:
            return RotationSymmetry(self.direction[slot], self.point[slot])
        return SphereSymmetry(self.point[slot])

    def weighted_by(self, factor: float) -> "SymmetrySlots":
        """Return the same symmetries with probabilities times `factor`."""
        return replace(self, probability=self.probability * factor)

    def between(self, above: float, below: float = np.inf) -> list[tuple[int, Symmetry]]:
        """Return slots and symmetries with a probability between `above` and `below`."""
        slots = np.flatnonzero((self.probability > above) & (self.probability < below)).tolist()
        return [(slot, self.symmetry(slot)) for slot in slots]
