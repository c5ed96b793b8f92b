"""What the training engine asks of a thing to be trained."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn


class Trainee(Protocol):
    """A module with its data and its loss; the engine in `loop.py` does the rest.

    Everything random is drawn from the generators handed in, which depend on seed, epoch and step
    alone: a training that is resumed goes on as if it had never stopped.

    Attributes:
        best_by: name of the validation figure that the kept weights are best in.
        higher_is_better: whether that figure is to rise.
        parallel: whether `loss` may run in several threads at a time.
    """

    best_by: str
    higher_is_better: bool
    parallel: bool

    @property
    def module(self) -> nn.Module:
        """What is trained."""
        ...

    def epoch(self, rng: np.random.Generator) -> Sequence[Any]:
        """Return one epoch's batches, as light descriptions of what to load."""
        ...

    def load(self, batch: Any, rng: np.random.Generator) -> Sequence[tuple[float, Any]]:  # noqa: ANN401
        """Return the micro-batches of a batch, each with its share of the batch's gradient."""
        ...

    def loss(
        self,
        module: nn.Module,
        micro_batch: Any,  # noqa: ANN401 - the trainee's own
        generator: torch.Generator,
    ) -> Mapping[str, Tensor]:
        """Return scalar loss terms by name, of a copy of `self.module`; `total` is minimised."""
        ...

    def validate(self) -> dict[str, float]:
        """Return validation figures by name, of the module's present weights."""
        ...
