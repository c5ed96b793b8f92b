"""The interface between the training engine and the thing to be trained."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn

Items = Any  # a sequence that slices give parts of
MicroBatch = Any  # the trainee's own


class Trainee(Protocol):
    """A module with its data and its loss; the engine in `loop.py` does the rest.

    All random numbers come from the given generators, which depend on seed, epoch, step and item
    alone: a resumed training goes on as if it had never stopped, and a training of several
    processes takes the same steps.
    """

    best_by: str  # the validation figure that chooses the weights to keep
    higher_is_better: bool  # whether a higher figure is better
    parallel: bool  # whether `loss` may run in several threads at a time
    micro_batch_size: int  # items that are worked on together; a batch's gradient is their sum

    @property
    def module(self) -> nn.Module:
        """The module to train."""

    def epoch(self, number: int, rng: np.random.Generator) -> Sequence[Items]:
        """Return the items of each batch of epoch `number`, light descriptions of what to load."""

    def load(self, items: Items, generators: Sequence[np.random.Generator]) -> MicroBatch:
        """Return the micro-batch of `items`, each drawing from its own generator."""

    def loss(
        self, module: nn.Module, micro_batch: MicroBatch, generator: torch.Generator
    ) -> Mapping[str, Tensor]:
        """Return scalar loss terms by name, of a copy of `self.module`; `total` is minimised."""

    def tensors(self, micro_batch: MicroBatch) -> dict[str, Tensor]:
        """Return a micro-batch as named tensors, to be written to a file."""

    def validate(self) -> dict[str, float]:
        """Return validation figures by name, of the module's present weights."""
