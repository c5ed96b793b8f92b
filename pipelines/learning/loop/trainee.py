"""The interface between the training engine and a module to train."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn

Items = Any  # a sequence that can be sliced
MicroBatch = Any  # of any type that the trainee uses


class Trainee(Protocol):
    """A module with its data and its loss; the engine in `loop.py` does the rest.

    All random numbers come from the given generators, which depend on seed, epoch, step and item
    alone: a resumed training continues as if it had never stopped, and a training of several
    processes takes the same steps.
    """

    best_by: str  # the validation figure that chooses the weights to keep
    higher_is_better: bool  # whether a higher figure is better
    parallel: bool  # whether `loss` may run in several threads at a time
    micro_batch_size: (
        int  # items processed together; a batch's gradient is the sum over micro-batches
    )

    @property
    def module(self) -> nn.Module:
        """The module to train."""

    def epoch(self, number: int, rng: np.random.Generator) -> Sequence[Items]:
        """Return the items of each batch of epoch `number`: light descriptions of the data."""

    def load(self, items: Items, generators: Sequence[np.random.Generator]) -> MicroBatch:
        """Return the micro-batch of `items`, each drawing from its own generator."""

    def loss(
        self, module: nn.Module, micro_batch: MicroBatch, generator: torch.Generator
    ) -> Mapping[str, Tensor]:
        """Return scalar loss terms by name for a copy of `self.module`; `total` is minimised."""

    def tensors(self, micro_batch: MicroBatch) -> dict[str, Tensor]:
        """Return a micro-batch as named tensors, to be written to a file."""

    def validate(self) -> dict[str, float]:
        """Return validation figures by name for the module's present weights."""
