"""Micro-batches of a batch, and their distribution over processes.

The regions of a micro-batch, and so the statistics of batch norm, do not depend on the number of
processes: a step with two processes differs from a step with one by rounding alone.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipelines.configs import FinetuneDetectorConfig, TrainBaselineConfig, TrainConfig
from pipelines.errors import ValueRangeError
from pipelines.learning.loop.trainee import Items, MicroBatch, Trainee
from pipelines.learning.speed.processes import Processes

TRAINING = 1_000_003  # separates trainings from datasets that draw from the same seed


@dataclass(frozen=True)
class PlannedMicroBatch:
    """One micro-batch of a batch, not loaded yet."""

    number: int  # index among the batch's micro-batches
    first: int  # position of its first item in the batch
    items: Items  # in the trainee's form
    share: float  # share of the batch's gradient; 0 where it only fills up a process

    def load(self, trainee: Trainee, seed: int, epoch: int, step: int) -> MicroBatch:
        """Load the items, each with the generator of its place in the batch."""
        places = range(self.first, self.first + len(self.items))
        drawing: list[np.random.Generator] = [generator(seed, epoch, step, i) for i in places]
        return trainee.load(self.items, drawing)


def micro_batches_of(batch: Items, size: int, processes: Processes) -> list[PlannedMicroBatch]:
    """Return this process's micro-batches of `batch`, at least one."""
    starts = range(0, len(batch), size)
    parts = [batch[first : first + size] for first in starts]
    planned = [
        PlannedMicroBatch(number, first, part, len(part) / len(batch))
        for number, (first, part) in enumerate(zip(starts, parts, strict=True))
    ]
    own = planned[processes.rank :: processes.count]
    # An epoch smaller than a batch may leave a process without one: it takes one without weight.
    return own or [replace(planned[0], share=0.0)]


def micro_batch_size(
    config: TrainConfig | FinetuneDetectorConfig | TrainBaselineConfig,
    on_cpu: int,
    processes: Processes,
) -> int:
    """Return the size of micro-batches: the setting, or a size for the device if the setting is 0.

    A CPU is fastest with a few items at a time, in several threads; a GPU with its whole share.
    `on_cpu`: the size for a CPU, 0 on a GPU.

    Raises:
        ValueRangeError: the processes cannot share a batch evenly.
    """
    wanted = config.micro_batch_size or on_cpu or -(-config.batch_size // processes.count)
    size = min(wanted, config.batch_size)
    count = -(-config.batch_size // size)
    if count % processes.count:
        raise ValueRangeError(
            f"number of micro-batches of {size} in a batch of {config.batch_size}",
            count,
            f"a multiple of the {processes.count} processes; change --batch-size or --micro-batch",
        )
    return size


def generator(seed: int, *place: int) -> np.random.Generator:
    """Return the generator of one place of a training, `place` counted from 0.

    The generator depends on the seed, epoch, step and item alone: a training that is resumed, or
    has several processes or other micro-batches, draws the same numbers.
    """
    # A spawn key, unlike a longer seed, distinguishes (1,) from (1, 0).
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(TRAINING, *place)))
