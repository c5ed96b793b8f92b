"""Interpolation from a coarse cloud to a finer one, compiled: who is near, and the weighted sum.

For three neighbours, to look at all points is quicker than to walk through a tree, as long as
there are a few hundred: queries are answered many at a time, and nothing is branched upon.
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

ABREAST = 64  # queries that are answered side by side
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
    query = np.zeros((3, ABREAST), queries.dtype)
    squared, near = np.empty((3, ABREAST), queries.dtype), np.empty((3, ABREAST), np.int32)
    for start in range(0, len(queries), ABREAST):
        stop = min(ABREAST, len(queries) - start)
        for c in range(3):
            for i in range(ABREAST):
                query[c, i] = queries[start + min(i, stop - 1), c]
                squared[c, i], near[c, i] = np.inf, 0
        for n in range(len(support)):
            _insert(query, support[n, 0], support[n, 1], support[n, 2], n, squared, near)
        for i in range(stop):
            near_first, near_second = one / (squared[0, i] + tiny), one / (squared[1, i] + tiny)
            near_third = one / (squared[2, i] + tiny)
            total = near_first + near_second + near_third
            for k in range(3):
                places[start + i, k] = near[k, i]
            weights[start + i, 0] = near_first / total
            weights[start + i, 1] = near_second / total
            weights[start + i, 2] = near_third / total


@compiled
def _insert(
    query: Numbers, x: float, y: float, z: float, n: int, squared: Numbers, near: NDArray[np.int32]
) -> None:
    """Put point `n` among the three nearest of each query where it is one of them."""
    place = np.int32(n)  # as narrow as distances are, or they are not compared side by side
    for i in range(ABREAST):
        a, b, c = query[0, i] - x, query[1, i] - y, query[2, i] - z
        d = a * a + b * b + c * c
        first, second, third = d < squared[0, i], d < squared[1, i], d < squared[2, i]
        squared[2, i] = squared[1, i] if second else (d if third else squared[2, i])
        near[2, i] = near[1, i] if second else (place if third else near[2, i])
        squared[1, i] = squared[0, i] if first else (d if second else squared[1, i])
        near[1, i] = near[0, i] if first else (place if second else near[1, i])
        squared[0, i] = d if first else squared[0, i]
        near[0, i] = place if first else near[0, i]


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
