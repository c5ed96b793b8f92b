"""Copy grasps across an object's symmetries (Sec. III-G, Fig. 6).

The copies of a grasp are its images under the symmetry's finite group: the mirror, the turns by
equal angles, or the icosahedron's 60 turns for a sphere. So what is symmetrized once has every
copy already, and doing it again adds nothing.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.geometry.transforms import rotation_about
from pipelines.grasping.grasps import Grasps

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# A mirrored gripper is left-handed; with its fingers renamed it is a gripper again.
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
CELL_SLACK = 0.9  # cells a little smaller than the merge distance, so that rounding cannot matter


def mirror(grasps: Grasps, plane: ReflectionSymmetry) -> Grasps:
    """Mirror every grasp in `plane`, both in the object frame.

    The approach is mirrored and the fingers trade places, so each rotation keeps determinant +1
    and the contacts are the mirror images of the old ones.
    """
    matrix = np.eye(3) - 2.0 * np.outer(plane.normal, plane.normal)
    return replace(
        grasps,
        rotation=matrix @ grasps.rotation @ SWAP_FINGERS,
        translation=plane.counterpart(grasps.translation),
    )


def turned(grasps: Grasps, rotation: ArrayLike, center: ArrayLike) -> Grasps:
    """Turn every grasp by `rotation` (3, 3) about the point `center` (3,)."""
    R, c = np.asarray(rotation, np.float64), np.asarray(center, np.float64)
    return replace(
        grasps, rotation=R @ grasps.rotation, translation=(grasps.translation - c) @ R.T + c
    )


def images(grasps: Grasps, symmetry: Symmetry, copies_per_turn: int) -> list[Grasps]:
    """Return the copies of `grasps` under `symmetry`, the originals left out."""
    match symmetry:
        case ReflectionSymmetry():
            return [mirror(grasps, symmetry)]
        case RotationSymmetry():
            count = copies_per_turn if symmetry.order is None else symmetry.order
            angles = 2.0 * np.pi * np.arange(1, count) / count
            turns = rotation_about(np.broadcast_to(symmetry.axis, (len(angles), 3)), angles)
            return [turned(grasps, turn, symmetry.point) for turn in turns]
        case SphereSymmetry():
            group = Rotation.create_group("I").as_matrix()
            others = [turn for turn in group if not np.allclose(turn, np.eye(3))]
            return [turned(grasps, turn, symmetry.point) for turn in others]


def num_images(symmetry: Symmetry, copies_per_turn: int) -> int:
    """Return how many copies of a grasp `images` makes."""
    return len(images(Grasps.empty(), symmetry, copies_per_turn))


def symmetrize(
    grasps: Grasps, symmetry: Symmetry, *, copies_per_turn: int, merge_distance: float
) -> tuple[Grasps, Indices]:
    """Return `grasps` with their copies under `symmetry`, and the original (m,) of each.

    The originals come first, all of them. A copy whose contacts lie within `merge_distance`
    metres of another grasp's is that grasp again, and is left out.
    """
    copies = images(grasps, symmetry, copies_per_turn)
    everything = Grasps.concatenate([grasps, *copies])
    origin = np.tile(np.arange(len(grasps)), len(copies) + 1)
    if not len(grasps):
        return everything, origin
    fresh = np.arange(len(grasps), len(everything))
    fresh = fresh[~_near(everything[fresh], grasps, merge_distance)]
    fresh = fresh[distinct(everything[fresh], merge_distance)]
    index = np.concatenate([np.arange(len(grasps)), fresh])
    return everything[index], origin[index]


def distinct(grasps: Grasps, merge_distance: float) -> Indices:
    """Return the indices of the first grasp of each group with the same contacts, ascending.

    Contact pairs fall into cells of which the diagonal, in the six numbers of a pair, is a little
    less than `merge_distance` metres: what is left out is closer than that to what is kept.
    """
    cells = _ordered(grasps.contacts, CELL_SLACK * merge_distance / np.sqrt(6.0))
    # One number a cell is sorted ten times faster than six; it wraps around, and two cells
    # share a number once in 10^19.
    numbers = (cells.astype(np.uint64) * CELL_FACTORS).sum(axis=1, dtype=np.uint64)
    return np.sort(np.unique(numbers, return_index=True)[1])


def _near(grasps: Grasps, others: Grasps, distance: float) -> NDArray[np.bool_]:
    """Return which `grasps` have the contacts of one of `others`, fingers in either order."""
    tree = KDTree(others.contacts.reshape(-1, 6))
    found = np.zeros(len(grasps), dtype=bool)
    for pair in (grasps.contacts, grasps.contacts[:, ::-1]):
        reach = tree.query(pair.reshape(-1, 6), distance_upper_bound=distance)[0]
        found |= np.isfinite(reach)
    return found


def _ordered(contacts: Array, cell: float) -> Indices:
    """Return the cells (n, 6) of contact pairs, the same for either order of the fingers."""
    cells = np.floor(contacts / cell).astype(np.int64)  # (n, 2, 3)
    difference = cells[:, 1] - cells[:, 0]
    first = (difference != 0).argmax(axis=1)
    swap = np.take_along_axis(difference, first[:, None], axis=1)[:, 0] < 0
    cells[swap] = cells[swap][:, ::-1]
    return cells.reshape(-1, 6)
