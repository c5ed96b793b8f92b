"""Grasps with their quality, a bounded sample of a stream, and the best grasp at each place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.grasping.grasps import GraspPoses, Index
from pipelines.grasping.symmetrize import CELL_FACTORS, cell_numbers


@dataclass(frozen=True)
class RatedGrasps:
    """Grasps with exact contacts, and `quality` (n,) = 1 - smallest friction coefficient."""

    grasps: GraspPoses
    quality: Array

    def __len__(self) -> int:
        return len(self.quality)

    def __getitem__(self, index: Index) -> "RatedGrasps":
        return RatedGrasps(self.grasps[index], self.quality[index])

    @classmethod
    def empty(cls) -> "RatedGrasps":
        """Return no grasps."""
        return cls(GraspPoses.empty(), np.zeros(0))

    @classmethod
    def concatenate(cls, parts: Sequence["RatedGrasps"]) -> "RatedGrasps":
        """Return all grasps of `parts`, in order."""
        quality = [np.zeros(0), *(part.quality for part in parts)]
        return cls(GraspPoses.concatenate([part.grasps for part in parts]), np.concatenate(quality))


# Contact pairs as in a file, in a third of the memory of grasps, their cells, and the numbers for
# drawing cells.
PAIR = np.dtype(
    [
        ("contacts", "f4", (2, 3)),
        ("approach", "f4", 3),
        ("quality", "f4"),
        ("cell", "u8"),
        ("draw", "u8"),
    ]
)


class GraspSample:
    """The best grasp of each group with the same contacts, in a stream of any length.

    If there are more than `limit` groups, `limit` of them are drawn with equal probability: the
    groups with the smallest hashes. The sample depends neither on the number of grasps in a group
    nor on the division of the stream into pieces.
    """

    def __init__(self, merge_distance: float, limit: int, seed: int) -> None:
        self._merge_distance, self._limit = merge_distance, limit
        self._seed = np.uint64(seed % 2**64)
        self._kept = [np.zeros(0, PAIR)]
        self._sorted = 0  # number of kept pairs that are distinct and best first
        self._cells: list[NDArray[np.uint64]] = []
        self._last = np.uint64(2**64 - 1)  # no later cell is drawn

    def add(self, rated: RatedGrasps) -> None:
        """Add further grasps."""
        pairs = np.zeros(len(rated), PAIR)
        pairs["contacts"], pairs["approach"] = rated.grasps.contacts, rated.grasps.approach
        pairs["quality"] = rated.quality
        cell = cell_numbers(pairs["contacts"].astype(np.float64), self._merge_distance)
        pairs["cell"], pairs["draw"] = cell, _hashed(cell ^ self._seed)
        self._cells.append(cell)
        self._kept.append(pairs[pairs["draw"] <= self._last])
        # Merge when new and old are equally many: each pair is sorted a few times, not hundreds.
        if sum(map(len, self._kept)) > 2 * max(self._sorted, self._limit // 4):
            self._merge()

    @property
    def num_distinct(self) -> int:
        """Number of groups of grasps with the same contacts in the stream."""
        cells = np.sort(np.concatenate([np.zeros(0, np.uint64), *self._cells]))
        return len(cells[:1]) + int(np.count_nonzero(cells[1:] != cells[:-1]))

    def result(self) -> RatedGrasps:
        """Return the kept grasps, best quality first."""
        pairs = self._merge()
        return RatedGrasps(
            GraspPoses.from_contacts(pairs["contacts"].astype(np.float64), pairs["approach"]),
            pairs["quality"].astype(np.float64).round(6),
        )

    def _merge(self) -> NDArray[np.void]:
        pairs = np.concatenate(self._kept)
        ranked = pairs[np.argsort(-pairs["quality"], kind="stable")]
        best = np.sort(np.unique(ranked["cell"], return_index=True)[1])
        if len(best) > self._limit:
            draw = ranked["draw"][best]
            self._last = np.partition(draw, self._limit - 1)[self._limit - 1]
            best = best[draw <= self._last]
        merged = ranked[best]
        self._kept, self._sorted = [merged], len(best)
        return merged


def best_of_places(parts: Sequence[RatedGrasps], size: float) -> RatedGrasps:
    """Return the best grasp of `parts` at each touched place, best quality first.

    Places are cells smaller than `size` metres. Up to this distance, the kept grasps give the same
    affordance as all grasps; a sample would not, as the best of few grasps is worse than the best
    of many. A stream may be processed part by part, each with the grasps kept from earlier parts.
    """
    both = RatedGrasps.concatenate(parts)
    ranked = np.argsort(-both.quality, kind="stable")
    places = np.floor(both.grasps.contacts[ranked] / (size / np.sqrt(3.0))).astype(np.int64)
    cell = (places.astype(np.uint64) * CELL_FACTORS[:3]).sum(axis=2, dtype=np.uint64)
    first = np.unique(cell.ravel(), return_index=True)[1] // 2  # two contacts per grasp
    return both[ranked[np.unique(first)]]


def _hashed(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return pseudo-random numbers, distinct for distinct `numbers` (the end of SplitMix64)."""
    mixed = (numbers ^ (numbers >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(mixed ^ (mixed >> np.uint64(31)))
