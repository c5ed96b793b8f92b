"""Pools of procedural objects: seen, similar (new instances of seen families), novel (families).

`wide` and `wide_similar` have more families than `seen` and `similar`; `sealed` has families that
no other pool has.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.errors import UnknownNameError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import Symmetry
from pipelines.synthesis.objects.decomposition import hull_of_points
from pipelines.synthesis.objects.families.catalogue import (
    NOVEL,
    SEALED,
    SEEN,
    WIDER_FAMILIES,
    make_shape,
)

# The order matters: an object's draws depend on the number of its pool.
FAMILIES_OF_POOL = {
    "seen": tuple(SEEN),
    "similar": tuple(SEEN),
    "novel": tuple(NOVEL),
    "wide": (*SEEN, *WIDER_FAMILIES),
    "wide_similar": (*SEEN, *WIDER_FAMILIES),
    "sealed": tuple(SEALED),
}

# The pool of each split, by the setting `families`: seen, similar, novel.
POOLS_OF_FAMILIES = {
    "first": ("seen", "similar", "novel"),
    "wide": ("wide", "wide_similar", "novel"),
    "sealed": ("wide", "wide_similar", "sealed"),
}
# Pools of objects that are never trained on.
UNSEEN_POOLS = ("similar", "novel", "wide_similar", "sealed")


@dataclass(frozen=True, eq=False)
class SyntheticObject:
    """An object with exact symmetries."""

    name: str  # unique in its pool
    family: str  # such as "bottle"
    mesh: Mesh  # closed mesh, metres, origin in the centre of its bounding box
    symmetries: tuple[Symmetry, ...]  # exact by construction
    pieces: tuple[Mesh, ...]  # convex meshes that together approximate the object, for physics


def make_object(pool: str, index: int, seed: int) -> SyntheticObject:
    """Return object `index` of `pool`; the same for the same seed, none in two pools.

    Families alternate, so that the first objects have different families.

    Raises:
        UnknownNameError: the pool is unknown.
    """
    if pool not in FAMILIES_OF_POOL:
        raise UnknownNameError("pool", pool, FAMILIES_OF_POOL)
    families, number = FAMILIES_OF_POOL[pool], list(FAMILIES_OF_POOL).index(pool)
    family = families[index % len(families)]
    shape = make_shape(family, np.random.default_rng([seed, number, index]))
    return SyntheticObject(
        f"{pool}_{index:03d}_{family}",
        family,
        shape.solid.mesh(),
        shape.symmetries,
        tuple(hull_of_points(points) for points in shape.solid.pieces),
    )
