"""Copy grasps across an object's symmetries (Sec. III-G, Fig. 6).

The copies of a grasp are its images under a finite group. For one symmetry, the group has the
mirror, turns by equal angles, or for a sphere the icosahedron's 60 turns; for several symmetries,
all products. So one call makes all copies, and a second call adds nothing.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from pipelines.array_types import Array, Indices, Mask
from pipelines.errors import ValueRangeError
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.geometry.transforms import make_pose, rotation_about, transform_points
from pipelines.grasping.grasps import GraspPoses

# A mirrored gripper is left-handed; swapping its fingers makes it right-handed again.
SWAP_FINGERS = np.diag([1.0, -1.0, 1.0])
# Odd 64-bit numbers without a pattern: fractional parts of the roots of the first primes.
CELL_FACTORS = np.array(
    [
        0x6A09E667F3BCC909,
        0xBB67AE8584CAA73B,
        0x3C6EF372FE94F82B,
        0xA54FF53A5F1D36F1,
        0x510E527FADE682D1,
        0x9B05688C2B3E6C1F,
    ],
    dtype=np.uint64,
)
LEAST_ORDER = 12  # errors of mirrors and turns measured on scans are below half a step
STEP_SHARE = 0.51  # of a step: every turn about a continuous axis is this near a copy
MAX_GROUP = 288  # transforms; a continuous axis, a plane across it and one along it make 143
MAX_COPIES = MAX_GROUP // 4  # per turn; a plane across and a plane along the axis multiply by 4
CELL_SLACK = 0.9  # cells are slightly smaller than the merge distance, against rounding


def image(grasps: GraspPoses, isometry: ArrayLike) -> GraspPoses:
    """Return `grasps` under an `isometry` (4, 4) that maps the object onto itself, same frame.

    Under a reflection, the approach is mirrored and the fingers are swapped, so rotations keep
    determinant +1 and the contacts are the images of the original contacts.
    """
    T = np.asarray(isometry, np.float64)
    rotation = T[:3, :3] @ grasps.rotation
    if np.linalg.det(T[:3, :3]) < 0.0:
        rotation = rotation @ SWAP_FINGERS
    return replace(grasps, rotation=rotation, translation=transform_points(T, grasps.translation))


def isometries(symmetry: Symmetry, copies_per_turn: int) -> Array:
    """Return the transforms (k, 4, 4) of `symmetry` without the identity."""
    match symmetry:
        case ReflectionSymmetry():
            matrices = np.eye(3)[None] - 2.0 * np.outer(symmetry.normal, symmetry.normal)
        case RotationSymmetry():
            count = copies_per_turn if symmetry.order is None else symmetry.order
            angles = 2.0 * np.pi * np.arange(1, count) / count
            matrices = rotation_about(np.broadcast_to(symmetry.axis, (len(angles), 3)), angles)
        case SphereSymmetry():
            group = Rotation.create_group("I").as_matrix()
            matrices = group[~np.isclose(group, np.eye(3)).all(axis=(1, 2))]
    return make_pose(matrices, symmetry.point - matrices @ symmetry.point)  # fixes the point


def symmetry_group(symmetries: Sequence[Symmetry], copies_per_turn: int) -> Array:
    """Return the transforms (k, 4, 4) of the group of `symmetries`, without the identity.

    Products are added until none is new, as the half turn of two crossed mirrors. So grasps copied
    once by the group have all copies, and copying again adds nothing. A sphere replaces all
    symmetries about its centre. Measured symmetries are inexact: a transform within half a step of
    a known transform counts as the same, since all symmetries of an object share its centre. Short
    products come first, at most MAX_GROUP.

    Raises:
        ValueRangeError: `copies_per_turn` is above MAX_COPIES, which would truncate groups.
    """
    if not 1 <= copies_per_turn <= MAX_COPIES:
        raise ValueRangeError("copies per turn", copies_per_turn, f"1 to {MAX_COPIES}")
    spheres = [each for each in symmetries if isinstance(each, SphereSymmetry)]
    generators = [isometries(each, copies_per_turn) for each in spheres[:1] or symmetries]
    steps = np.concatenate([np.zeros((0, 4, 4)), *generators])
    turns = [each for each in symmetries if isinstance(each, RotationSymmetry)]
    finest = max([LEAST_ORDER, *(each.order or copies_per_turn for each in turns)])
    half_step = STEP_SHARE * 2.0 * np.pi / finest
    group, fresh = np.eye(4)[None], np.eye(4)[None]
    while len(fresh) and len(group) <= MAX_GROUP:
        products = (fresh[:, None] @ steps[None]).reshape(-1, 4, 4)
        fresh = _new_transforms(products, group, half_step)
        group = np.concatenate([group, fresh])
    return group[1 : MAX_GROUP + 1]


def _new_transforms(products: Array, known: Array, angle: float) -> Array:
    """Return the `products` that differ by more than `angle` from `known` and each other."""
    reach = 2.0 * np.sqrt(2.0) * np.sin(angle / 2.0)  # of matrices that differ by this angle

    def matrices(transforms: Array) -> Array:
        return transforms[:, :3, :3].reshape(-1, 9)

    gap = KDTree(matrices(known)).query(matrices(products), distance_upper_bound=reach)[0]
    products = products[~np.isfinite(gap)]
    repeated = np.zeros(len(products), dtype=bool)
    if len(products):
        pairs = KDTree(matrices(products)).query_pairs(reach, output_type="ndarray")
        for first, second in pairs[np.lexsort(pairs.T[::-1])]:
            repeated[second] |= not repeated[first]
    return products[~repeated]


def copies_under(
    grasps: GraspPoses,
    group: Array,
    *,
    merge_distance: float,
    max_copies: int,
    rng: np.random.Generator,
) -> tuple[GraspPoses, Indices]:
    """Return copies of `grasps` under the transforms `group` (k, 4, 4), and their originals (m,).

    A copy with contacts within `merge_distance` metres of a grasp's or another copy's contacts is
    left out. If there were more than `max_copies`, each transform copies equally many grasps, drawn
    separately, so that no part of the object and no quality is favoured; of more transforms than
    `max_copies`, some are drawn.
    """
    if len(group) > max_copies:
        group = group[np.sort(rng.choice(len(group), max_copies, replace=False))]
    share, origin = max_copies // max(1, len(group)), np.arange(len(grasps))
    if len(grasps) <= share:
        chosen = [origin] * len(group)
    else:
        chosen = [np.sort(rng.choice(len(grasps), share, replace=False)) for _ in group]
    parts = [image(grasps[index], T) for index, T in zip(chosen, group, strict=True)]
    copies, origin = GraspPoses.concatenate(parts), np.concatenate([origin[:0], *chosen])
    if not len(copies):
        return copies, origin
    fresh = np.flatnonzero(~_near(copies, grasps, merge_distance))
    fresh = fresh[distinct(copies[fresh], merge_distance)]
    return copies[fresh], origin[fresh]


def distinct(grasps: GraspPoses, merge_distance: float) -> Indices:
    """Return the indices (k,) of the first grasp of each group with the same contacts, ascending.

    `merge_distance`: metres, as in `cell_numbers`.
    """
    numbers = cell_numbers(grasps.contacts, merge_distance)
    return np.sort(np.unique(numbers, return_index=True)[1])


def cell_numbers(contacts: Array, merge_distance: float) -> NDArray[np.uint64]:
    """Return a number (n,) for each of `contacts` (n, 2, 3): the same for the same pair.

    Contact pairs are sorted into cells; the diagonal of a cell, in the six numbers of a pair, is
    slightly less than `merge_distance` metres, so pairs of a cell are closer. The fingers' order
    does not matter.
    """
    side = CELL_SLACK * merge_distance / np.sqrt(6.0)
    cells = np.floor(contacts / side).astype(np.int64)  # (n, 2, 3)
    difference = cells[:, 1] - cells[:, 0]
    first = (difference != 0).argmax(axis=1)
    swap = np.take_along_axis(difference, first[:, None], axis=1)[:, 0] < 0
    cells[swap] = cells[swap][:, ::-1]
    # One number per cell is sorted ten times faster than six. Numbers wrap around, and two cells
    # share a number once in 10^19.
    numbers = cells.reshape(-1, 6).astype(np.uint64) * CELL_FACTORS
    return np.asarray(numbers.sum(axis=1, dtype=np.uint64))


def _near(grasps: GraspPoses, others: GraspPoses, distance: float) -> Mask:
    """Return a mask of `grasps` with the contacts of one of `others`, in either finger order."""
    either = np.stack([grasps.contacts, grasps.contacts[:, ::-1]]).reshape(2, -1, 6)
    tree = KDTree(others.contacts.reshape(-1, 6))
    reach = tree.query(either, distance_upper_bound=distance)[0]
    return np.asarray(np.isfinite(reach).any(axis=0))
