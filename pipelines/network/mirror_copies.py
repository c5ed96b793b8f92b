"""Joint output of the network for regions and for their mirror images (D. 101).

The mirror swaps left and right, the first axis of both input frames, as training does. The two
outputs differ where the network is uncertain, and their mean is better than either output.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Singles
from pipelines.geometry.symmetry import NUM_SLOTS, REFLECTION_SLOTS

MIRROR: Singles = np.diag([-1.0, 1.0, 1.0]).astype(np.float32)


@dataclass(frozen=True)
class RegionOutputs:
    """The network's output for B regions of N points, M of which vote for symmetries."""

    affordance: Singles  # (B, N)
    existence: Singles  # (B, M, 5) probabilities
    center: Singles  # (B, M, 5, 3) metres
    direction: Singles  # (B, M, 5, 3) unit; zeros for the sphere

    def mirrored(self) -> "RegionOutputs":
        """Return the outputs in the mirror image of the frame."""
        center, direction = self.center @ MIRROR, self.direction @ MIRROR
        return RegionOutputs(self.affordance, self.existence, center, direction)


def with_copy(outputs: RegionOutputs, of_copy: RegionOutputs) -> RegionOutputs:
    """Return the mean affordance, and the symmetries of both, 2 M per region.

    `of_copy`: outputs for the mirrored regions, mirrored back. The network may predict a plane in
    any slot, and in another slot for the copy: the slots of the copy are reordered so that its
    planes agree best with the planes of `outputs`.
    """
    existence, center, direction = [], [], []
    for region in range(len(outputs.affordance)):
        order = _slot_order(outputs.direction[region], of_copy.direction[region])
        existence.append(of_copy.existence[region][:, order])
        center.append(of_copy.center[region][:, order])
        direction.append(of_copy.direction[region][:, order])
    return RegionOutputs(
        0.5 * (outputs.affordance + of_copy.affordance),
        np.concatenate([outputs.existence, np.stack(existence)], 1),
        np.concatenate([outputs.center, np.stack(center)], 1),
        np.concatenate([outputs.direction, np.stack(direction)], 1),
    )


def _slot_order(
    direction: Singles,  # (M, 5, 3)
    of_copy: Singles,  # (M, 5, 3)
) -> list[int]:
    """Return for each slot the slot of the copy with the same symmetry."""
    planes = np.array(REFLECTION_SLOTS)
    first, second = (
        np.einsum("mki,mkj->kij", each[:, planes], each[:, planes]) for each in (direction, of_copy)
    )
    agreement = np.einsum("aij,bij->ab", first, second)
    orders = itertools.permutations(REFLECTION_SLOTS)
    best = max(orders, key=lambda order: float(agreement[planes, order].sum()))
    return [*best, *range(len(planes), NUM_SLOTS)]
