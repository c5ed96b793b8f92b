"""Pooling of the groups of a set abstraction: one cloud after the other, in one pass.

The largest tensor of the network, a row for each member of each group, is written part by part and
stays in the cache until it is pooled. In each channel only the member with the maximum has a
gradient, so that the backward pass is a sum over few rows.
"""

from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipelines.array_types import Floats, Indices
from pipelines.geometry.numerics.compiled import compiled
from pipelines.network import devices
from pipelines.network.cpu.cloudwise import each_cloud
from pipelines.network.cpu.products import linear

Members = NDArray[np.int32]

ROWS = 2048  # approximate number of members of groups processed at a time


def applies_to(projected: Tensor, offset: Tensor, neighbors: Tensor, group: nn.Linear) -> bool:
    """Return whether `fast_pooled_groups` may be used: on a CPU, in the precision of the inputs."""
    del offset, neighbors, group
    return devices.on_cpu(projected) and not torch.is_autocast_enabled("cpu")


def fast_pooled_groups(
    projected: Tensor,  # (B, N, C)
    offset: Tensor,  # (B, M, C)
    neighbors: Tensor,  # (B, M, K)
    group: nn.Linear,  # from C to D
) -> Tensor:
    """Return (B, M, D), as `network.pointnet2.pooled_groups` does.

    If several members have the maximum, the gradient goes to the first.
    """
    pooled: Tensor = _PooledGroups.apply(projected, offset, neighbors, group.weight)
    return pooled


class _PooledGroups(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch's context object
        projected: Tensor,
        offset: Tensor,
        neighbors: Tensor,
        weight: Tensor,
    ) -> Tensor:
        pooled = projected.new_empty(*neighbors.shape[:2], len(weight))
        winners = torch.empty(pooled.shape, dtype=torch.int32)
        pool = partial(_pool_cloud, weight.detach())
        each_cloud(pool, projected, offset, neighbors, pooled, winners)
        ctx.save_for_backward(projected, offset, neighbors, weight, winners)
        return pooled

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        projected, offset, neighbors, weight, winners = ctx.saved_tensors
        back = torch.zeros_like(projected), torch.zeros_like(offset)
        shares = weight.new_zeros(len(projected), *weight.shape)
        through = partial(_add_gradients, weight.detach().contiguous().numpy())
        each_cloud(through, projected, offset, neighbors, winners, gradients[0], *back, shares)
        return *back, None, shares.sum(0)


def _pool_cloud(
    weight: Tensor,
    projected: Floats,
    offset: Floats,
    neighbors: Indices,
    pooled: Floats,
    winners: Members,
) -> None:
    """Set `pooled` (m, d) to the maxima of a cloud's groups, `winners` to the members with them."""
    centers, members = neighbors.shape
    step = max(1, ROWS // members)
    hidden = weight.new_empty(min(step, centers) * members, weight.shape[1])
    for start in range(0, centers, step):
        some = slice(start, start + step)
        count = len(neighbors[some]) * members
        _rectify(projected, offset[some], neighbors[some], hidden.numpy())
        grouped = linear(hidden[:count], weight).numpy()
        _maximize(grouped, members, pooled[some], winners[some])


@compiled
def _rectify(projected: Floats, offset: Floats, neighbors: Indices, hidden: Floats) -> None:
    """Set `hidden` (m k, c) to relu(projected[neighbors] + offset), `neighbors`: (m, k)."""
    members, zero = neighbors.shape[1], hidden.dtype.type(0.0)
    for m in range(len(offset)):
        for k in range(members):
            n = neighbors[m, k]
            for c in range(offset.shape[1]):
                value = projected[n, c] + offset[m, c]
                hidden[m * members + k, c] = value if value > zero else zero


@compiled
def _maximize(grouped: Floats, members: int, pooled: Floats, winners: Members) -> None:
    """Set `pooled` (m, c) to the maxima of `members` rows each of `grouped` (m members, c)."""
    for m in range(len(pooled)):
        for c in range(pooled.shape[1]):
            pooled[m, c], winners[m, c] = grouped[m * members, c], 0
        for k in range(1, members):
            member = np.int32(k)
            for c in range(pooled.shape[1]):
                value = grouped[m * members + k, c]
                more = value > pooled[m, c]
                pooled[m, c] = value if more else pooled[m, c]
                winners[m, c] = member if more else winners[m, c]


@compiled
def _add_gradients(
    weight: Floats,
    projected: Floats,
    offset: Floats,
    neighbors: Indices,
    winners: Members,
    gradient: Floats,
    to_projected: Floats,
    to_offset: Floats,
    to_weight: Floats,
) -> None:
    """Add the gradients of the inputs to the last three, from `gradient` (m, d) of the maxima."""
    members, zero = neighbors.shape[1], weight.dtype.type(0.0)
    hidden = np.empty((members, weight.shape[1]), weight.dtype)
    to_hidden = np.empty_like(hidden)
    for m in range(len(neighbors)):
        for k in range(members):
            for c in range(weight.shape[1]):
                hidden[k, c] = max(projected[neighbors[m, k], c] + offset[m, c], zero)
                to_hidden[k, c] = zero
        for d in range(len(weight)):
            share, k = gradient[m, d], winners[m, d]
            for c in range(weight.shape[1]):
                to_weight[d, c] += share * hidden[k, c]
                to_hidden[k, c] += share * weight[d, c]
        for k in range(members):
            n = neighbors[m, k]
            for c in range(weight.shape[1]):
                share = to_hidden[k, c] if hidden[k, c] > zero else zero
                to_projected[n, c] += share
                to_offset[m, c] += share
