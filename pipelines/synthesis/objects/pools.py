"""Pools of procedural objects: seen, similar (new instances of seen families), novel (families)."""

from dataclasses import dataclass
from itertools import cycle, islice

import numpy as np

from pipelines.errors import UnknownNameError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import Symmetry
from pipelines.synthesis.objects.decomposition import hull_of_points
from pipelines.synthesis.objects.families.catalogue import NOVEL, SEEN, make_shape

FAMILIES_OF_POOL = {"seen": tuple(SEEN), "similar": tuple(SEEN), "novel": tuple(NOVEL)}


@dataclass(frozen=True, eq=False)
class SyntheticObject:
    """An object with exact symmetries.

    Attributes:
        name: name, unique in its pool.
        family: family, such as "bottle".
        mesh: closed mesh, metres, origin in the centre of its bounding box.
        symmetries: exact by construction.
        pieces: convex meshes that together approximate the object, for physics.
    """

    name: str
    family: str
    mesh: Mesh
    symmetries: tuple[Symmetry, ...]
    pieces: tuple[Mesh, ...]


def make_pool(pool: str, count: int, seed: int) -> list[SyntheticObject]:
    """Return the first `count` objects of `pool`; the same for the same seed, none in two pools.

    Families alternate, so all families occur if `count` is at least their number.

    Raises:
        UnknownNameError: there is no such pool.
    """
    if pool not in FAMILIES_OF_POOL:
        raise UnknownNameError("pool", pool, FAMILIES_OF_POOL)
    turns = islice(cycle(FAMILIES_OF_POOL[pool]), count)
    number = list(FAMILIES_OF_POOL).index(pool)
    return [_make(pool, index, family, [seed, number, index]) for index, family in enumerate(turns)]


def _make(pool: str, index: int, family: str, seed: list[int]) -> SyntheticObject:
    shape = make_shape(family, np.random.default_rng(seed))
    return SyntheticObject(
        f"{pool}_{index:03d}_{family}",
        family,
        shape.solid.mesh(),
        shape.symmetries,
        tuple(hull_of_points(points) for points in shape.solid.pieces),
    )
