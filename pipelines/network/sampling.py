"""Which points a layer looks at: farthest points, nearest neighbours, three-nearest weights.

On the CPU loops of ours answer, one cloud a thread; elsewhere plain torch does. Both compare the
same squares in single precision, so that devices agree on all but the order of points equally far.
Nothing here has a gradient: indices do not, and interpolation weights are of fixed points.
"""

import torch
from torch import Tensor
from torch.nn import functional

from pipelines.network import devices
from pipelines.network.cpu.cloudwise import each_cloud
from pipelines.network.cpu.interpolation import interpolated
from pipelines.network.cpu.neighbors import find_farthest, find_nearest, find_three_nearest

TINY = 1e-8  # keeps weights finite where a query is one of the points


@torch.no_grad()
def farthest_points(
    points: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return indices (B, count) of points far from each other, the same ones each time.

    After the first point, each next one is the farthest from all that were chosen before.
    """
    if count >= points.shape[1]:
        return torch.arange(points.shape[1], device=points.device).expand(points.shape[:2])
    if not devices.on_cpu(points):
        return _farthest_points_torch(points.float(), count)
    chosen = torch.empty(len(points), count, dtype=torch.int64)
    each_cloud(find_farthest, points.float(), chosen)
    return chosen


def _farthest_points_torch(points: Tensor, count: int) -> Tensor:
    batch = torch.arange(len(points), device=points.device)
    chosen = torch.zeros(len(points), count, dtype=torch.int64, device=points.device)
    distance = torch.full(points.shape[:2], torch.inf, device=points.device)
    for i in range(1, count):
        last = points[batch, chosen[:, i - 1]][:, None]
        distance = torch.minimum(distance, _squared_gap(points, last))
        chosen[:, i] = distance.argmax(-1)
    return chosen


@torch.no_grad()
def nearest_neighbors(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return indices (B, M, min(count, N)) of the support points nearest to each query."""
    if not devices.on_cpu(queries):
        return _nearest_torch(queries, support, count)
    index = torch.empty(*queries.shape[:2], min(count, support.shape[1]), dtype=torch.int64)
    each_cloud(find_nearest, queries.float(), support.float(), index)
    return index


@torch.no_grad()
def three_nearest(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
) -> tuple[Tensor, Tensor]:
    """Return indices and weights (B, M, 3) that interpolate from `support` at `queries`.

    Weights are inverse squared distances that sum to one, as PointNet++ has them. Where there are
    fewer than three points, weights of zero (on a CPU) or fewer columns take the others' place.
    """
    if devices.on_cpu(queries):
        index = queries.new_empty(*queries.shape[:2], 3, dtype=torch.int64)
        squared_gap = queries.new_empty(index.shape)
        each_cloud(find_three_nearest, queries, support, index, squared_gap)
    else:
        index = _nearest_torch(queries, support, 3)
        squared_gap = _squared_gap(queries[:, :, None], gather(support, index))
    weight = 1.0 / (squared_gap + TINY)
    return index, weight / weight.sum(-1, keepdim=True)


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
    if devices.on_cpu(values):
        return interpolated(values, index, weight)
    bags = _flat(values, index).reshape(-1, index.shape[2])
    summed = functional.embedding_bag(
        bags, values.flatten(0, 1), per_sample_weights=weight.flatten(0, 1), mode="sum"
    )
    return summed.view(len(values), index.shape[1], values.shape[2])


def _flat(values: Tensor, index: Tensor) -> Tensor:
    """Return indices (B, ...) into the clouds of `values` laid end to end."""
    start = torch.arange(len(values), device=values.device) * values.shape[1]
    return index + start.view(-1, *[1] * (index.dim() - 1))


def _nearest_torch(queries: Tensor, support: Tensor, count: int) -> Tensor:
    squared = _squared_gap(queries.float()[:, :, None], support.float()[:, None])
    return squared.topk(min(count, support.shape[1]), dim=-1, largest=False)[1]


def _squared_gap(points: Tensor, others: Tensor) -> Tensor:
    """Return squared distances, summed in the order that the loops sum in."""
    x, y, z = (points - others).unbind(-1)
    return x * x + y * y + z * z
