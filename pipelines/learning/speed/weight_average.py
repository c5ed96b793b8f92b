"""The running mean of a module's weights, less noisy than the weights of the last step."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import torch
from torch import Tensor, nn


class WeightAverage:
    """Exponential running mean of all floating-point state; other state stays the module's."""

    def __init__(self, module: nn.Module, decay: float) -> None:
        self.module, self.decay = module, decay
        self._mean = {name: each.detach().clone() for name, each in self._live().items()}

    def _live(self) -> dict[str, Tensor]:
        state = self.module.state_dict()
        return {name: each for name, each in state.items() if each.is_floating_point()}

    @torch.no_grad()
    def update(self, step: int) -> None:
        """Add the weights after step number `step`, counted from 1.

        The first means are over fewer steps, so that they forget the random start.
        """
        decay = min(self.decay, step / (step + 10.0))
        for mean, live in zip(self._mean.values(), self._live().values(), strict=True):
            mean.lerp_(live, 1.0 - decay)

    @contextmanager
    def applied(self) -> Iterator[None]:
        """Give the module the mean weights inside the context."""
        own = {name: each.detach().clone() for name, each in self._live().items()}
        try:
            self._set(self._mean)
            yield
        finally:
            self._set(own)

    @torch.no_grad()
    def _set(self, tensors: Mapping[str, Tensor]) -> None:
        live = self._live()
        for name, tensor in tensors.items():
            live[name].copy_(tensor)

    def state(self) -> dict[str, Tensor]:
        """Return the mean by name."""
        return dict(self._mean)

    def load(self, state: Mapping[str, Tensor]) -> None:
        """Set the mean to a result of `state`, on the device of the module."""
        self._mean = {name: state[name].to(each, copy=True) for name, each in self._mean.items()}
