"""Linear layers that give a cloud the same result in any batch, to the last bit (D. 61).

A product of matrices sums few rows in another order than many, and the last rows in another than
the first; and a last bit decides which points are sampled. So on a CPU, without gradients, each
cloud is a product of its own. The next layer follows at once, while the cloud is near the
processor.
"""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import cast

import torch
from torch import Tensor, nn

from pipelines.network import devices
from pipelines.network.cpu.products import linear


def taken_apart(features: Tensor) -> bool:
    """Return whether clouds are worked on one by one: on a CPU, without gradients."""
    return devices.on_cpu(features) and not torch.is_grad_enabled()


def each_cloud(function: Callable[..., None], *clouds: Tensor) -> None:
    """Call `function` with the i-th cloud of each tensor as arrays, clouds in parallel.

    The tensors that it writes to are contiguous.
    """
    arrays = [cloud.detach().contiguous().numpy() for cloud in clouds]
    if torch.get_num_threads() > 1 and len(arrays[0]) > 1:
        list(threads_of_one_core().map(function, *arrays))
        return
    for each in zip(*arrays, strict=True):
        function(*each)


def threads_of_one_core() -> ThreadPoolExecutor:
    """Return as many threads as torch has; kept, as a new thread costs as much as a cloud.

    Each process has its own: a fork has none of its parent's.
    """
    return _threads(torch.get_num_threads(), os.getpid())


@lru_cache(maxsize=2)
def _threads(count: int, process: int) -> ThreadPoolExecutor:
    del process
    return ThreadPoolExecutor(count, initializer=_use_one_core)


def _use_one_core() -> None:
    torch.get_num_threads()  # at the first call torch sets the number that was set last anywhere
    torch.set_num_threads(1)


class CloudLinear(nn.Linear):
    """A linear layer of the points of several clouds.

    `rectifies`: outputs are clipped at zero; for folded networks.
    """

    rectifies = False

    def forward(
        self,
        features: Tensor,  # (B, ..., C)
    ) -> Tensor:
        """Return features (B, ..., out)."""
        if taken_apart(features):
            return _through([self], features)
        found = super().forward(features)
        return found.relu_() if self.rectifies else found

    def of_cloud(
        self,
        cloud: Tensor,  # (N, C)
    ) -> Tensor:
        """Return features (N, out) of one cloud's points, without gradients."""
        return linear(cloud, self.weight, cast("Tensor | None", self.bias), self.rectifies)


class CloudChain(nn.Sequential):
    """Linear layers in a row: a cloud goes through all of them before the next cloud does."""

    def forward(
        self,
        features: Tensor,  # (B, ..., C)
    ) -> Tensor:
        """Return features (B, ..., out)."""
        if taken_apart(features):
            return _through(cast("Iterable[CloudLinear]", self), features)
        found: Tensor = super().forward(features)  # type: ignore[no-untyped-call]
        return found


def _through(layers: Iterable[CloudLinear], features: Tensor) -> Tensor:
    """Return the output of `layers` for features (B, ..., C), one cloud after the other."""
    layers = tuple(layers)
    found = features.new_empty((*features.shape[:-1], layers[-1].out_features))
    for cloud, out in zip(features.flatten(1, -2), found.flatten(1, -2), strict=True):
        for layer in layers:
            cloud = layer.of_cloud(cloud)  # noqa: PLW2901 - the input of the next layer
        out.copy_(cloud)
    return found


class RowLinear(nn.Linear):
    """A linear layer that sums each row in the same order, at any place among other rows.

    For one row a cloud, or one number a row: a product of matrices sums a single row, and the last
    rows of a product with a vector, in an order of their own.
    """

    def forward(
        self,
        features: Tensor,  # (..., C)
    ) -> Tensor:
        """Return features (..., out)."""
        return (features[..., None, :] * self.weight).sum(-1) + self.bias
