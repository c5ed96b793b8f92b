"""Layers of PointNet++: set abstraction and feature propagation.

Linear layers come before grouping and before interpolation, with unchanged results: a layer of
(p_j - c_i, e_j) is W [p_j, e_j] - W_p c_i, so that it is applied once to each point and not once
per group. Activations are normalised after pooling, where they are fewer.
"""

import torch
from torch import Tensor, nn

from pipelines.network.cpu.grouping import applies_to, fast_pooled_groups
from pipelines.network.cpu.twins import faster_by
from pipelines.network.sampling import (
    farthest_points,
    gather,
    interpolation_weights,
    nearest_neighbors,
    weighted_sum,
)


class PointNorm(nn.BatchNorm1d):
    """Batch normalisation of features (..., C) over all points of all clouds."""

    def forward(self, features: Tensor) -> Tensor:
        """Return the features normalised, in their shape."""
        normalised: Tensor = super().forward(features.flatten(0, -2))
        return normalised.view(features.shape)


class SetAbstraction(nn.Module):
    """Sample points, group their neighbours, and pool a small network over each group.

    Neighbours are the k nearest points, not the points within a radius: a group then has as many
    points on a large object as on a small one, and follows PIFT's scaling. The search is among
    every `stride`-th point, which widens a group of the same size.

    A `stride` above 1 assumes that the order of the points says nothing of their places, so that
    every n-th point covers the cloud: the input is in random order, and sampled points come
    farthest first. Points in the order of pixels would leave rows or columns out.
    """

    def __init__(
        self,
        in_dim: int,
        dims: tuple[int, int, int],
        num_points: int,
        num_neighbors: int,
        stride: int = 1,
    ) -> None:
        super().__init__()
        self.num_points, self.num_neighbors, self.stride = num_points, num_neighbors, stride
        self.position = nn.Linear(3, dims[0], bias=False)
        self.content = nn.Linear(in_dim, dims[0])
        self.group = nn.Linear(dims[0], dims[1], bias=False)
        self.point = nn.Sequential(
            PointNorm(dims[1]), nn.ReLU(), nn.Linear(dims[1], dims[2]), PointNorm(dims[2])
        )

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        features: Tensor,  # (B, N, C)
    ) -> tuple[Tensor, Tensor]:
        """Return sampled points (B, M, 3) and their features (B, M, dims[2]) (Eq. 4)."""
        centers = gather(points, farthest_points(points, self.num_points))
        points, features = points[:, :: self.stride], features[:, :: self.stride]
        neighbors = nearest_neighbors(centers, points, self.num_neighbors)
        projected = self.position(points) + self.content(features)
        pooled = pooled_groups(projected, self.position(-centers), neighbors, self.group)
        return centers, torch.relu(self.point(pooled))


@faster_by(fast_pooled_groups, applies_to)
def pooled_groups(
    projected: Tensor,  # (B, N, C)
    offset: Tensor,  # (B, M, C)
    neighbors: Tensor,  # (B, M, K)
    group: nn.Linear,  # from C to D
) -> Tensor:
    """Return features (B, M, D) of M groups: the maximum of `group` over the K members of each."""
    # In place on the sum, which is no view: autograd would keep and copy the base of a view.
    hidden = torch.relu_(gather(projected, neighbors) + offset[:, :, None])
    pooled: Tensor = group(hidden)
    return pooled.amax(-2)


class FeaturePropagation(nn.Module):
    """Interpolate coarse features at finer points and join them with the features there."""

    def __init__(self, coarse_dim: int, fine_dim: int, out_dim: int) -> None:
        super().__init__()
        self.coarse = nn.Linear(coarse_dim, out_dim, bias=False)
        self.fine = nn.Linear(fine_dim, out_dim)
        self.joined = nn.Sequential(
            PointNorm(out_dim), nn.ReLU(), nn.Linear(out_dim, out_dim), PointNorm(out_dim)
        )

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        features: Tensor,  # (B, N, fine_dim)
        coarse_points: Tensor,  # (B, M, 3)
        coarse_features: Tensor,  # (B, M, coarse_dim)
    ) -> Tensor:
        """Return features (B, N, out_dim) at the finer points."""
        index, weight = interpolation_weights(points, coarse_points)
        interpolated = weighted_sum(self.coarse(coarse_features), index, weight)
        return torch.relu(self.joined(interpolated + self.fine(features)))
