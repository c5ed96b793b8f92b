"""Sources of training regions: packed regions, endlessly rendered regions, or both.

An item is a pair: (-1, index) of a packed region, (scene, slot) of a rendered region.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipelines.array_types import Indices
from pipelines.configs import EndlessConfig, TrainConfig
from pipelines.dataset.training.packed_regions import PackedReader, PackedRegion
from pipelines.learning.loop.loaders import batch_of, draw_points, epoch_batches
from pipelines.network.training.region_batch import RegionBatch

if TYPE_CHECKING:
    from pipelines.synthesis.endless_pool import EndlessPool

PACKED = -1


@dataclass(frozen=True)
class RegionSet:
    """Some of the regions of a packed folder."""

    reader: PackedReader
    indices: Indices


@dataclass(frozen=True)
class TrainingRegions:
    """Packed regions, rendered regions, or a share of each in every batch."""

    packed: RegionSet | None
    rendered: "EndlessPool | None"
    config: TrainConfig

    def epoch(self, number: int, rng: np.random.Generator) -> list[Indices]:
        """Return the items (B, 2) of the batches of epoch `number`, counted from 0.

        An epoch shows each packed region at most once; without packed regions it has
        `epoch_regions` regions.
        """
        size, endless = self.config.batch_size, self.config.endless
        fresh = round(size * endless.share) if self.rendered else 0
        if self.packed is None or fresh == size:
            batches = [np.zeros((0, 2), np.int64)] * max(1, endless.epoch_regions // size)
        else:
            chosen = epoch_batches(self.packed.indices, size - fresh, rng)
            batches = [packed_items(batch) for batch in chosen]
        if not fresh:
            return batches
        items = rendered_items(number, fresh * len(batches), endless, rng)
        parts = np.split(items, len(batches))
        both = (np.concatenate(pair) for pair in zip(batches, parts, strict=True))
        return [rng.permutation(batch) for batch in both]

    def load(self, items: Indices, generators: Sequence[np.random.Generator]) -> RegionBatch:
        """Return regions, each with as many points as the network takes, drawn and centred."""
        network, lost = self.config.network, self.config.augmentation.lost_table
        pairs = zip(items.tolist(), generators, strict=True)
        return batch_of([draw_points(self._region(*at), network, rng, lost) for at, rng in pairs])

    def _region(self, scene: int, index: int) -> PackedRegion:
        if scene == PACKED and self.packed is not None:
            return self.packed.reader[index]
        if scene != PACKED and self.rendered is not None:
            return self.rendered.region(scene, index)
        raise LookupError(f"item ({scene}, {index}) is of a source that this training lacks")


def packed_items(indices: Indices) -> Indices:
    """Return the items (n, 2) of packed regions."""
    return np.column_stack([np.full(len(indices), PACKED), indices]).astype(np.int64)


def rendered_items(
    epoch: int, count: int, config: EndlessConfig, rng: np.random.Generator
) -> Indices:
    """Return `count` items (n, 2) of scenes that no other epoch shows.

    The order is random within each group of scenes; groups follow each other, so that few scenes
    are kept at a time.
    """
    in_group = config.scenes_together * config.regions_per_scene
    groups = -(-count // in_group)
    first = epoch * groups * config.scenes_together
    items = []
    for group in range(groups):
        scenes = first + group * config.scenes_together + np.arange(config.scenes_together)
        pairs = np.stack(np.meshgrid(scenes, np.arange(config.regions_per_scene)), -1)
        items.append(rng.permutation(pairs.reshape(-1, 2)))
    return np.concatenate(items)[:count].astype(np.int64)
