"""Groups of points in balls and cylinders: the first points inside, as in the original PointNet++.

Points are in random order, so the first points are a random choice. If too few points are inside,
the first is repeated.
"""

import torch
from torch import Tensor

from pipelines.network.sampling import gather, three_nearest

SMALLEST = 1e-8  # metres, keeps weights finite if a query is one of the points


@torch.no_grad()
def points_in_balls(
    centers: Tensor,  # (B, M, 3)
    points: Tensor,  # (B, N, 3)
    radius: float,
    count: int,
) -> Tensor:
    """Return indices (B, M, count) of points within `radius` of each centre."""
    return first_inside(torch.cdist(centers, points) < radius, count)[0]


def first_inside(
    inside: Tensor,  # (..., N) bool
    count: int,
) -> tuple[Tensor, Tensor]:
    """Return the first `count` indices (..., count) where `inside`, and whether any is (...)."""
    place = inside.to(torch.int32).cumsum(-1)
    kept = inside & (place <= count)
    *where, index = kept.nonzero(as_tuple=True)
    found = torch.full((*inside.shape[:-1], count), -1, dtype=torch.int64, device=inside.device)
    found[(*where, place[kept].long() - 1)] = index
    first = found[..., :1].clamp(min=0)
    return torch.where(found < 0, first, found), found[..., 0] >= 0


def interpolated(
    queries: Tensor,  # (B, M, 3)
    points: Tensor,  # (B, N, 3)
    features: Tensor,  # (B, N, C)
) -> Tensor:
    """Return features (B, M, C) of the three nearest points, weighted by inverse distance."""
    with torch.no_grad():
        index, squared = three_nearest(queries, points)
        weight = 1.0 / (squared.clamp(min=0.0).sqrt() + SMALLEST)
        weight = weight / weight.sum(-1, keepdim=True)
    return (gather(features, index) * weight[..., None]).sum(2)
