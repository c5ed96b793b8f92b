"""Predictions of regions and of their mirror images, averaged (D. 101).

The mirror swaps left and right, the first axis of both input frames, as training does. Two answers
differ where the network is not sure, and what they have in common is surer than either.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Singles
from pipelines.geometry.symmetry import NUM_SLOTS, REFLECTION_SLOTS

MIRROR: Singles = np.diag([-1.0, 1.0, 1.0]).astype(np.float32)


@dataclass(frozen=True)
class Told:
    """What the network tells of B regions of N points, M of which tell symmetries.

    Attributes:
        affordance: (B, N).
        existence: (B, M, 5) probabilities.
        center: (B, M, 5, 3) metres.
        direction: (B, M, 5, 3) unit; zeros for the sphere.
    """

    affordance: Singles
    existence: Singles
    center: Singles
    direction: Singles

    def mirrored(self) -> "Told":
        """Return the same in the mirror image of its frame."""
        return Told(self.affordance, self.existence, self.center @ MIRROR, self.direction @ MIRROR)


def joined(told: Told, of_copy: Told) -> Told:
    """Return the mean affordance, and the symmetries of both, 2 M a region.

    `of_copy`: of the mirrored regions, brought back. Which slot a plane is told in is the
    network's choice, and another one for the copy: its slots are put in the order in which its
    planes agree best with those of `told`.
    """
    existence, center, direction = [], [], []
    for region in range(len(told.affordance)):
        order = _slot_order(told.direction[region], of_copy.direction[region])
        existence.append(of_copy.existence[region][:, order])
        center.append(of_copy.center[region][:, order])
        direction.append(of_copy.direction[region][:, order])
    return Told(
        0.5 * (told.affordance + of_copy.affordance),
        np.concatenate([told.existence, np.stack(existence)], 1),
        np.concatenate([told.center, np.stack(center)], 1),
        np.concatenate([told.direction, np.stack(direction)], 1),
    )


def _slot_order(
    direction: Singles,  # (M, 5, 3)
    of_copy: Singles,  # (M, 5, 3)
) -> list[int]:
    """Return for each slot which slot of the copy tells the same."""
    planes = np.array(REFLECTION_SLOTS)
    first, second = (
        np.einsum("mki,mkj->kij", told[:, planes], told[:, planes]) for told in (direction, of_copy)
    )
    agreement = np.einsum("aij,bij->ab", first, second)
    orders = itertools.permutations(REFLECTION_SLOTS)
    best = max(orders, key=lambda order: float(agreement[planes, order].sum()))
    return [*best, *range(len(planes), NUM_SLOTS)]
