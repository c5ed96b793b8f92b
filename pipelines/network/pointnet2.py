"""PointNet++ layers: set abstraction and feature propagation, arranged for few operations.

Two rewritings leave the result as it is. A linear layer of (p_j - c_i, e_j) is
(W [p_j, e_j]) - W_p c_i, so it is applied to each point once and not to each of its groups; and
a linear layer commutes with interpolation, so it is applied to the few coarse points.
Activations are normalised after pooling, where they are sixteen times fewer.
"""

import torch
from torch import Tensor, nn

from pipelines.network.cpu import grouping
from pipelines.network.cpu.cloudwise import CloudLinear, taken_apart
from pipelines.network.cpu.interpolation import add_interpolated
from pipelines.network.cpu.pooling import max_over_group
from pipelines.network.sampling import (
    farthest_points,
    gather,
    nearest_neighbors,
    three_nearest,
    weighted_sum,
)


class PointNorm(nn.BatchNorm1d):
    """Batch norm of features (..., C) over all points of all clouds."""

    def forward(self, features: Tensor) -> Tensor:
        """Return the features normalised, in their shape."""
        normalised: Tensor = super().forward(features.flatten(0, -2))
        return normalised.view(features.shape)


class SetAbstraction(nn.Module):
    """Sample points, group their neighbours, and pool a small network over each group.

    Neighbours are the k nearest, not those within a radius: a group then has the same number of
    points on a large object as on a small one, and follows PIFT's scaling. With a stride they are
    sought among every so many points: a wider group of the same size, as a radius with more points
    in it than are taken gives in the original. Points are in random order.
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
        self.position = CloudLinear(3, dims[0], bias=False)
        self.content = CloudLinear(in_dim, dims[0])
        self.group = CloudLinear(dims[0], dims[1], bias=False)
        self.point = nn.Sequential(
            PointNorm(dims[1]), nn.ReLU(), CloudLinear(dims[1], dims[2]), PointNorm(dims[2])
        )

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        features: Tensor,  # (B, N, C)
    ) -> tuple[Tensor, Tensor]:
        """Return sampled points (B, M, 3) and their features (B, M, dims[2]).  # Eq. 4."""
        centers = gather(points, farthest_points(points, self.num_points))
        points, features = points[:, :: self.stride], features[:, :: self.stride]
        neighbors = nearest_neighbors(centers, points, self.num_neighbors)
        projected = self.position(points) + self.content(features)
        pooled = self._pooled(projected, self.position(-centers), neighbors)
        return centers, torch.relu(self.point(pooled))

    def _pooled(
        self,
        projected: Tensor,  # (B, N, dims[0])
        offset: Tensor,  # (B, M, dims[0])
        neighbors: Tensor,  # (B, M, K)
    ) -> Tensor:
        """Return the groups' features (B, M, dims[1])."""
        if grouping.applies_to(projected) and isinstance(self.group, CloudLinear):
            return grouping.pooled_groups(projected, offset, neighbors, self.group.weight)
        # In place on the sum, which is no view: of a view, autograd would keep and copy the whole.
        hidden = torch.relu_(gather(projected, neighbors) + offset[:, :, None])
        return max_over_group(self.group(hidden))


class FeaturePropagation(nn.Module):
    """Interpolate coarse features at finer points and join them with what is known there."""

    def __init__(self, coarse_dim: int, fine_dim: int, out_dim: int) -> None:
        super().__init__()
        self.coarse = CloudLinear(coarse_dim, out_dim, bias=False)
        self.fine = CloudLinear(fine_dim, out_dim)
        self.joined = nn.Sequential(
            PointNorm(out_dim), nn.ReLU(), CloudLinear(out_dim, out_dim), PointNorm(out_dim)
        )

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        features: Tensor,  # (B, N, fine_dim)
        coarse_points: Tensor,  # (B, M, 3)
        coarse_features: Tensor,  # (B, M, coarse_dim)
    ) -> Tensor:
        """Return features (B, N, out_dim) at the finer points."""
        index, weight = three_nearest(points, coarse_points)
        interpolated = weighted_sum(self.coarse(coarse_features), index, weight)
        return torch.relu(self.joined(interpolated + self.fine(features)))


class FoldedPropagation(nn.Module):
    """A feature propagation whose norms have become part of its linear layers."""

    def __init__(self, coarse: CloudLinear, fine: CloudLinear, joined: CloudLinear) -> None:
        super().__init__()
        self.coarse, self.fine, self.joined = coarse, fine, joined
        self.joined.rectifies = True

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        features: Tensor,  # (B, N, fine_dim)
        coarse_points: Tensor,  # (B, M, 3)
        coarse_features: Tensor,  # (B, M, coarse_dim)
    ) -> Tensor:
        """Return features (B, N, out_dim) at the finer points."""
        index, weight = three_nearest(points, coarse_points)
        coarse = self.coarse(coarse_features)
        if not taken_apart(features):
            interpolated = weighted_sum(coarse, index, weight)
            told: Tensor = self.joined(torch.relu(interpolated + self.fine(features)))
            return told
        found: Tensor = coarse.new_empty(*features.shape[:2], self.joined.out_features)
        near = zip(*(each.numpy() for each in (coarse, index, weight)), strict=True)
        for cloud, out, (rows, places, weights) in zip(features, found, near, strict=True):
            hidden = self.fine.of_cloud(cloud)
            add_interpolated(True, rows, places, weights, hidden.numpy())
            out.copy_(self.joined.of_cloud(hidden))
        return found
