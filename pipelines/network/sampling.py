"""Choices of points: farthest points, nearest neighbours, weights of interpolation; weighted sums.

Distances are compared in single precision, so that devices agree on all but the order of equally
far points. Indices and weights have no gradient.
"""

import torch
from torch import Tensor
from torch.nn import functional

from pipelines.network.cpu.neighbors import (
    fast_farthest_points,
    fast_nearest_neighbors,
    fast_three_nearest,
)
from pipelines.network.cpu.twins import faster_by

TINY = 1e-8  # keeps weights finite if a query is one of the points


@torch.no_grad()
def farthest_points(
    points: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return indices (B, count) of points far from each other, without random draws.

    After the first point, each next point is the farthest from all chosen points.
    """
    if count >= points.shape[1]:
        return torch.arange(points.shape[1], device=points.device).expand(points.shape[:2])
    return _farthest_points(points.float(), count)


@faster_by(fast_farthest_points)
def _farthest_points(
    points: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return the result of `farthest_points` for more points than `count`."""
    batch = torch.arange(len(points), device=points.device)
    chosen = torch.zeros(len(points), count, dtype=torch.int64, device=points.device)
    distance = torch.full(points.shape[:2], torch.inf, device=points.device)
    for i in range(1, count):
        last = points[batch, chosen[:, i - 1]][:, None]
        distance = torch.minimum(distance, _squared_distance(points, last))
        chosen[:, i] = distance.argmax(-1)
    return chosen


@faster_by(fast_nearest_neighbors)
def nearest_neighbors(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return indices (B, M, min(count, N)) of the support points nearest to each query."""
    squared = _squared_distance(queries.float()[:, :, None], support.float()[:, None])
    return squared.topk(min(count, support.shape[1]), dim=-1, largest=False)[1]


@torch.no_grad()
def interpolation_weights(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
) -> tuple[Tensor, Tensor]:
    """Return indices and weights (B, M, 3) that interpolate from `support` at `queries`.

    Weights are inverse squared distances that sum to one, as in PointNet++. With fewer than three
    points, missing points have zero weights (on a CPU) or no columns.
    """
    index, squared = three_nearest(queries, support)
    weight = 1.0 / (squared + TINY)
    return index, weight / weight.sum(-1, keepdim=True)


@faster_by(fast_three_nearest)
def three_nearest(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
) -> tuple[Tensor, Tensor]:
    """Return indices and squared distances (B, M, 3) of the nearest support points."""
    index = nearest_neighbors(queries, support, 3)
    return index, _squared_distance(queries[:, :, None], gather(support, index))


def gather(
    values: Tensor,  # (B, N, C)
    index: Tensor,  # (B, ...)
) -> Tensor:
    """Return `values` (B, ..., C) at `index`, cloud by cloud."""
    picked = values.flatten(0, 1).index_select(0, _flat(values, index).reshape(-1))
    return picked.view(*index.shape, values.shape[2])


def weighted_sum(
    values: Tensor,  # (B, N, C)
    index: Tensor,  # (B, M, K)
    weight: Tensor,  # (B, M, K)
) -> Tensor:
    """Return sums (B, M, C) of `values` at `index`, each times its `weight`."""
    bags = _flat(values, index).reshape(-1, index.shape[2])
    summed = functional.embedding_bag(
        bags, values.flatten(0, 1), per_sample_weights=weight.flatten(0, 1), mode="sum"
    )
    return summed.view(len(values), index.shape[1], values.shape[2])


def _flat(values: Tensor, index: Tensor) -> Tensor:
    """Return indices (B, ...) into the concatenated clouds of `values`."""
    start = torch.arange(len(values), device=values.device) * values.shape[1]
    return index + start.view(-1, *[1] * (index.dim() - 1))


def _squared_distance(points: Tensor, others: Tensor) -> Tensor:
    """Return squared distances, summed in the order of the compiled loops."""
    x, y, z = (points - others).unbind(-1)
    return x * x + y * y + z * z
