"""Linear layers that give a cloud the same result in any batch, to the last bit (D. 61).

A product of matrices sums in an order that depends on the number of rows, and the last rows in
another order than the first; and a last bit decides which points are sampled. So on a CPU, without
gradients, each cloud has a separate product. The next layer follows at once, while the cloud is in
the cache.
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
    """Return whether clouds are processed one by one: on a CPU, without gradients."""
    return devices.on_cpu(features) and not torch.is_grad_enabled()


def each_cloud(function: Callable[..., None], *clouds: Tensor) -> None:
    """Call `function` with the i-th cloud of each tensor as arrays, clouds in parallel.

    The tensors that `function` writes to must be contiguous.
    """
    arrays = [cloud.detach().contiguous().numpy() for cloud in clouds]
    if torch.get_num_threads() > 1 and len(arrays[0]) > 1:
        list(threads_of_one_core().map(function, *arrays))
        return
    for each in zip(*arrays, strict=True):
        function(*each)


def threads_of_one_core() -> ThreadPoolExecutor:
    """Return a pool of as many threads as torch has, kept since new threads are slow to start.

    Each process has its own pool, since a fork has no threads of its parent.
    """
    return _threads(torch.get_num_threads(), os.getpid())


@lru_cache(maxsize=2)
def _threads(count: int, process: int) -> ThreadPoolExecutor:
    del process
    return ThreadPoolExecutor(count, initializer=_use_one_core)


def _use_one_core() -> None:
    torch.get_num_threads()  # at its first call torch sets the number that any thread set last
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

    For one row per cloud, or one number per row: a product of matrices sums a single row, and the
    last rows of a product with a vector, in a different order.
    """

    def forward(
        self,
        features: Tensor,  # (..., C)
    ) -> Tensor:
        """Return features (..., out)."""
        return (features[..., None, :] * self.weight).sum(-1) + self.bias
