"""What a set abstraction makes of its groups, for the CPU: one cloud after the other, in one pass.

The largest tensor of the network, a row for each member of each group, is written once and stays
near the processor until it is pooled. The same numbers as layer by layer, to the last bit.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.geometry.compiled import compiled

Singles = NDArray[np.float32]


def applies_to(features: Tensor) -> bool:
    """Return whether `pooled_groups` can be used: no gradients, on a CPU, in single precision."""
    on_cpu = features.device.type == "cpu" and features.dtype == torch.float32
    return on_cpu and not torch.is_grad_enabled() and not torch.is_autocast_enabled("cpu")


def pooled_groups(
    projected: Tensor,  # (B, N, C)
    offset: Tensor,  # (B, M, C)
    neighbors: Tensor,  # (B, M, K)
    weight: Tensor,  # (D, C)
) -> Tensor:
    """Return (B, M, D) the maximum over each group of W relu(projected + offset)."""
    size, centers, members = neighbors.shape
    pooled = projected.new_empty(size, centers, len(weight))
    hidden = projected.new_empty(centers * members, projected.shape[2])
    grouped = projected.new_empty(centers * members, len(weight))
    columns = (each.contiguous().numpy() for each in (projected, offset, neighbors))
    for rows, aside, index, out in zip(*columns, pooled, strict=True):
        _rectified(rows, aside, index, hidden.numpy())
        torch.mm(hidden, weight.t(), out=grouped)
        torch.amax(grouped.view(centers, members, -1), 1, out=out)
    return pooled


@compiled
def _rectified(
    projected: Singles, offset: Singles, index: NDArray[np.int64], hidden: Singles
) -> None:
    """Set `hidden` (m k, c) to relu(projected[index] + offset), `index`: (m, k)."""
    members = index.shape[1]
    for m in range(len(offset)):
        for k in range(members):
            n = index[m, k]
            for c in range(offset.shape[1]):
                value = projected[n, c] + offset[m, c]
                hidden[m * members + k, c] = value if value > 0 else np.float32(0.0)
