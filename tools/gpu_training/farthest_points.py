"""Farthest point sampling by one kernel per cloud; plain torch starts some 4,000 kernels."""

import torch
import triton
import triton.language as tl
from torch import Tensor

LARGE = 1024  # points; blocks of this size or larger use eight warps


@triton.jit
def _farthest(points, chosen, size, count, BLOCK: tl.constexpr) -> None:  # noqa: ANN001
    cloud = tl.program_id(0)
    at = tl.arange(0, BLOCK)
    inside = at < size
    base = points + cloud * size * 3
    x = tl.load(base + at * 3, mask=inside, other=0.0)
    y = tl.load(base + at * 3 + 1, mask=inside, other=0.0)
    z = tl.load(base + at * 3 + 2, mask=inside, other=0.0)
    distance = tl.where(inside, float("inf"), -1.0)
    last = 0
    tl.store(chosen + cloud * count, 0)
    for i in range(1, count):
        dx = x - tl.load(base + last * 3)
        dy = y - tl.load(base + last * 3 + 1)
        dz = z - tl.load(base + last * 3 + 2)
        gap = dx * dx + dy * dy + dz * dz
        distance = tl.where(inside, tl.minimum(distance, gap), -1.0)
        last = tl.argmax(distance, 0)
        tl.store(chosen + cloud * count + i, last.to(tl.int64))


def sample_farthest(points: Tensor, count: int) -> Tensor:
    """Return indices (B, count) of points (B, N, 3) far from each other, the first point first."""
    points = points.contiguous()
    chosen = torch.empty(points.shape[0], count, dtype=torch.int64, device=points.device)
    block = triton.next_power_of_2(points.shape[1])
    _farthest[(points.shape[0],)](
        points, chosen, points.shape[1], count, BLOCK=block, num_warps=8 if block >= LARGE else 4
    )
    return chosen
