"""The symmetries of a region with the confidence in each, slot by slot."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.geometry.symmetry import NUM_SLOTS, Symmetry, SymmetrySlots, symmetry_of_slot


@dataclass(frozen=True)
class RegionSymmetries:
    """Symmetries in the five slots: 0 to 2 mirror planes, 3 rotation axis, 4 sphere. Camera frame.

    Attributes:
        confidence: (5,) 0 to 1, the belief in each symmetry; 0 where there is none.
        point: (5, 3) metres; nan where there is none.
        direction: (5, 3) unit; nan where there is none, and for the sphere.
        source: (5,) of the candidate: `network`, `shape` or `both`; empty where it is not known.
    """

    confidence: Array
    point: Array
    direction: Array
    source: NDArray[np.str_] = field(default_factory=lambda: np.full(NUM_SLOTS, "", "U7"))

    @classmethod
    def of(cls, symmetries: Iterable[tuple[int, Symmetry, float]]) -> "RegionSymmetries":
        """Return `symmetries`: the slot, the symmetry and the confidence in it."""
        empty = np.full((NUM_SLOTS, 3), np.nan)
        found = cls(np.zeros(NUM_SLOTS), empty, empty.copy())
        for slot, symmetry, confidence in symmetries:
            found.confidence[slot] = confidence
            found.point[slot], found.direction[slot] = symmetry.point, symmetry.direction
        return found

    @classmethod
    def unfitted(cls, slots: SymmetrySlots, source: str = "") -> "RegionSymmetries":
        """Return symmetries as they are predicted, or as they truly are: existence is believed."""
        sources = np.full(NUM_SLOTS, source, "U7")
        return cls(slots.existence, slots.point, slots.direction, sources)

    def between(self, above: float, below: float = np.inf) -> list[tuple[int, Symmetry]]:
        """Return slot and symmetry where the confidence lies `above` and `below` these."""
        slots = np.flatnonzero((self.confidence > above) & (self.confidence < below)).tolist()
        return [(slot, self.symmetry(slot)) for slot in slots]

    def symmetry(self, slot: int) -> Symmetry:
        """Return the symmetry of a slot that holds one."""
        return symmetry_of_slot(slot, self.point[slot], self.direction[slot])
