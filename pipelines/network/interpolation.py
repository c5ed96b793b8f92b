"""Interpolation from a coarse cloud to a finer one, compiled: who is near, and the weighted sum.

The coarse points stand in order along the axis on which they spread most, and a query looks at
those beside its place, outward until that axis alone parts them farther than the third nearest is.
"""

from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.geometry.compiled import compiled
from pipelines.network.cloudwise import each_cloud

Numbers = NDArray[np.floating]
Places = NDArray[np.int64]

TINY = 1e-8  # keeps weights finite where a query is one of the points


@compiled
def find_three_nearest(
    queries: Numbers, support: Numbers, places: Places, weights: Numbers
) -> None:
    """Set (m, 3) to the points (n, 3) nearest to each query (m, 3), and to their weights.

    Weights are inverse squared distances that sum to one; those of points that are not there,
    where n is less than 3, are zero. Of points equally far the first ones are taken.
    """
    one, tiny = weights.dtype.type(1.0), weights.dtype.type(TINY)
    axis = _widest(support)
    order = np.argsort(support[:, axis])
    along = support[order, axis]
    squared, near = np.empty(3, support.dtype), np.empty(3, np.int64)
    for m in range(len(queries)):
        x, y, z, at = queries[m, 0], queries[m, 1], queries[m, 2], queries[m, axis]
        squared[:], near[:] = np.inf, 0
        above = np.searchsorted(along, at)
        below = above - 1
        # A sum of squares comes out no smaller than one of them, however it is rounded.
        while above < len(along) and (along[above] - at) * (along[above] - at) <= squared[2]:
            n = order[above]
            a, b, c = x - support[n, 0], y - support[n, 1], z - support[n, 2]
            _insert(a * a + b * b + c * c, n, squared, near)
            above += 1
        while below >= 0 and (along[below] - at) * (along[below] - at) <= squared[2]:
            n = order[below]
            a, b, c = x - support[n, 0], y - support[n, 1], z - support[n, 2]
            _insert(a * a + b * b + c * c, n, squared, near)
            below -= 1
        total = weights.dtype.type(0.0)
        for k in range(3):
            places[m, k], weights[m, k] = near[k], one / (squared[k] + tiny)
            total += weights[m, k]
        for k in range(3):
            weights[m, k] /= total


@compiled
def _widest(points: Numbers) -> int:
    """Return the axis along which `points` (n, 3) spread most."""
    widest, most = 0, -1.0
    for axis in range(points.shape[1]):
        spread = points[:, axis].max() - points[:, axis].min()
        if spread > most:
            widest, most = axis, spread
    return widest


@compiled
def _insert(d: float, place: int, squared: Numbers, near: Places) -> None:
    """Put a point among the three nearest (3,) if it is one of them."""
    if d > squared[2]:
        return
    k = 3
    while k > 0 and (d < squared[k - 1] or (d == squared[k - 1] and place < near[k - 1])):
        if k < 3:
            squared[k], near[k] = squared[k - 1], near[k - 1]
        k -= 1
    if k < 3:
        squared[k], near[k] = d, place


def interpolated(
    values: Tensor,  # (B, N, C)
    places: Tensor,  # (B, M, 3)
    weights: Tensor,  # (B, M, 3)
) -> Tensor:
    """Return sums (B, M, C) of `values` at `places`, each times its weight."""
    summed: Tensor = _Interpolated.apply(values, places, weights)
    return summed


class _Interpolated(torch.autograd.Function):
    """Weights have no gradient."""

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
    rectifies: bool, coarse: Numbers, places: Places, weights: Numbers, fine: Numbers
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
def _spread(fine: Numbers, places: Places, weights: Numbers, coarse: Numbers) -> None:
    """Add rows (m, c) of `fine` to those of `coarse` (n, c) at their places, by weight."""
    for m in range(len(fine)):
        for k in range(3):
            n, weight = places[m, k], weights[m, k]
            for c in range(fine.shape[1]):
                coarse[n, c] += weight * fine[m, c]
