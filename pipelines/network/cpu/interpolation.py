"""Weighted sums of a few points of a cloud, and their gradients, compiled."""

from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pipelines.array_types import Floats, Indices
from pipelines.geometry.numerics.compiled import compiled
from pipelines.network.cpu.cloudwise import each_cloud


def fast_weighted_sum(
    values: Tensor,  # (B, N, C)
    index: Tensor,  # (B, M, 3)
    weight: Tensor,  # (B, M, 3)
) -> Tensor:
    """Return (B, M, C), as `network.sampling.weighted_sum` does."""
    summed: Tensor = _Interpolated.apply(values, index, weight)
    return summed


class _Interpolated(torch.autograd.Function):
    """Sums with a gradient of the values; the weights have none."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, places: Tensor, weights: Tensor) -> Tensor:  # noqa: ANN401
        summed = values.new_zeros(*places.shape[:2], values.shape[2])
        each_cloud(partial(add_interpolated, False), values, places, weights, summed)
        ctx.save_for_backward(places, weights)
        ctx.size = values.shape
        return summed

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        back = gradients[0].new_zeros(ctx.size)
        each_cloud(_spread, gradients[0], *ctx.saved_tensors, back)
        return back, None, None


@compiled
def add_interpolated(
    rectifies: bool, coarse: Floats, places: Indices, weights: Floats, fine: Floats
) -> None:
    """Add to `fine` (m, c) the weighted sums of rows (n, c) of `coarse`.

    `places` and `weights` are (m, 3). Where it `rectifies`, nothing below zero is left.
    """
    least = fine.dtype.type(0.0 if rectifies else -np.inf)
    for m in range(len(fine)):
        i, j, k = places[m, 0], places[m, 1], places[m, 2]
        u, v, w = weights[m, 0], weights[m, 1], weights[m, 2]
        for c in range(fine.shape[1]):
            value = u * coarse[i, c] + v * coarse[j, c] + w * coarse[k, c] + fine[m, c]
            fine[m, c] = least if value < least else value


@compiled
def _spread(fine: Floats, places: Indices, weights: Floats, coarse: Floats) -> None:
    """Add rows (m, c) of `fine` to those of `coarse` (n, c) at their places, by weight."""
    for m in range(len(fine)):
        for k in range(3):
            n, weight = places[m, k], weights[m, k]
            for c in range(fine.shape[1]):
                coarse[n, c] += weight * fine[m, c]
