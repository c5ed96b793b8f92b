"""GraspNet's baseline: an approach, an operation and a tolerance network on PointNet++ features.

Fang et al.: GraspNet-1Billion, CVPR 2020. Layers are as in the authors' release: 641,856,
236,028, 42,048, 54,564 and 51,468 parameters. The light variant sees fewer points and smaller
groups.
"""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.peers.point_groups import first_inside, interpolated, points_in_balls
from pipelines.network.pointnet2 import PointNorm
from pipelines.network.sampling import farthest_points, gather

VIEWS, NUM_TURNS, DEPTHS = 300, 12, 4
RADII = (0.04, 0.1, 0.2, 0.3)  # metres, radius of the balls at each level
CROP_RADIUS, CROP_BEHIND, DEPTH_STEP = 0.05, 0.02, 0.01  # metres, measures of the cylinders
WIDEST_OPENING = 0.1  # metres; predicted widths are shares of this opening
WIDEST_TOLERANCE = 0.05  # metres; predicted tolerances are shares of this value


@dataclass(frozen=True)
class Sizes:
    """Points of the input, points and members of groups at each level, members of cylinders."""

    input: int
    points: tuple[int, int, int, int]
    members: tuple[int, int, int, int]
    crop: int


GRASPNET_SIZES = {
    "light": Sizes(8192, (1024, 512, 256, 128), (32, 16, 16, 16), 32),
    "full": Sizes(20_000, (2048, 1024, 512, 256), (64, 32, 16, 16), 64),
}


@dataclass(frozen=True)
class Seeds:
    """Seeds of grasps: points (B, S, 3), indices (B, S) in the input, and predictions.

    Attributes:
        points: places of the seeds, metres.
        index: indices of the seeds among the input's points.
        objectness: (B, S, 2) logits of background and object.
        views: (B, S, 300) scores of approaching against each view.
    """

    points: Tensor
    index: Tensor
    objectness: Tensor
    views: Tensor


@dataclass(frozen=True)
class Operations:
    """Predictions for each seed at four depths: scores, angle logits, widths, tolerances.

    All are (B, S, 4, 12); widths and tolerances are shares of the widest values.
    """

    score: Tensor
    angle: Tensor
    width: Tensor
    tolerance: Tensor


class GraspNetBaseline(nn.Module):
    """Points in; seeds with approaches out, then operations at chosen approaches."""

    def __init__(self, config: PeerNetworkConfig) -> None:
        super().__init__()
        self.config, self.sizes = config, GRASPNET_SIZES[config.variant]
        dims = ((0, 64, 64, 128), (128, 128, 128, 256), (256, 128, 128, 256), (256, 128, 128, 256))
        levels = zip(dims, RADII, self.sizes.members, strict=True)
        self.levels = nn.ModuleList(BallAbstraction(*each) for each in levels)
        self.merges = nn.ModuleList(_shared(512, 256, 256) for _ in range(2))
        self.approach = nn.Sequential(
            nn.Linear(256, 256), PointNorm(256), nn.ReLU(),
            nn.Linear(256, 2 + VIEWS), PointNorm(2 + VIEWS), nn.ReLU(),
            nn.Linear(2 + VIEWS, 2 + VIEWS),
        )  # fmt: skip
        self.crop = _shared(3, 64, 128, 256)
        self.operation, self.tolerance = _head(3 * NUM_TURNS), _head(NUM_TURNS)

    def seeds(
        self,
        points: Tensor,  # (B, N, 3) metres, camera frame, in random order
    ) -> tuple[Seeds, Tensor]:
        """Return the seeds and their features (B, S, 256)."""
        places, features, index = [points], [points[..., :0]], []
        for level, count in zip(self.levels, self.sizes.points, strict=True):
            chosen = farthest_points(places[-1], count)
            centers = gather(places[-1], chosen)
            features.append(level(centers, places[-1], features[-1]))
            places.append(centers)
            index.append(chosen)
        merged = features[4]
        for fine, merge in zip((3, 2), self.merges, strict=True):
            coarse = interpolated(places[fine], places[fine + 1], merged)
            merged = merge(torch.cat([features[fine], coarse], dim=-1))
        output = self.approach(merged)
        places_in_input = index[0].gather(1, index[1])
        return Seeds(places[2], places_in_input, output[..., :2], output[..., 2:]), merged

    def operations(
        self,
        points: Tensor,  # (B, N, 3)
        origin: Tensor,  # (B, S, 3)
        rotation: Tensor,  # (B, S, 3, 3) columns approach, closing, binormal at angle 0
    ) -> Operations:
        """Return the predictions from the points in cylinders along the approach."""
        crops, found = self._cylinders(points, origin, rotation)
        pooled = self.crop(crops).amax(dim=3) * found[..., None]
        output = self.operation(pooled)
        score, angle, width = output.split(NUM_TURNS, dim=-1)
        return Operations(score, angle, width, self.tolerance(pooled))

    @torch.no_grad()
    def _cylinders(self, points: Tensor, origin: Tensor, rotation: Tensor) -> tuple[Tensor, Tensor]:
        """Return crops (B, S, 4, K, 3) in the frames of the seeds, and whether each has a point."""
        local = torch.einsum("bsnc,bscd->bsnd", points[:, None] - origin[:, :, None], rotation)
        near = local[..., 1:].square().sum(-1) < CROP_RADIUS**2
        near &= local[..., 0] > -CROP_BEHIND
        reach = DEPTH_STEP * torch.arange(1, DEPTHS + 1, device=points.device)
        groups = [first_inside(near & (local[..., 0] < end), self.sizes.crop) for end in reach]
        crops = [local.gather(2, index[..., None].expand(-1, -1, -1, 3)) for index, _ in groups]
        return torch.stack(crops, dim=2), torch.stack([found for _, found in groups], dim=2)


class BallAbstraction(nn.Module):
    """Features of balls: relative offsets joined to features, a network, the maximum."""

    def __init__(self, dims: tuple[int, int, int, int], radius: float, members: int) -> None:
        super().__init__()
        self.radius, self.members = radius, members
        self.layers = _shared(dims[0] + 3, *dims[1:])

    def forward(
        self,
        centers: Tensor,  # (B, M, 3)
        points: Tensor,  # (B, N, 3)
        features: Tensor,  # (B, N, C)
    ) -> Tensor:
        """Return features (B, M, D) of the balls about `centers`."""
        index = points_in_balls(centers, points, self.radius, self.members)
        offset = (gather(points, index) - centers[:, :, None]) / self.radius
        members = [offset, gather(features, index)] if features.shape[2] else [offset]
        return self.layers(torch.cat(members, dim=-1)).amax(dim=2)  # type: ignore[no-any-return]


def _shared(*dims: int) -> nn.Sequential:
    """Return layers that all points share, with batch norm in place of biases."""
    layers: list[nn.Module] = []
    for before, after in pairwise(dims):
        layers += [nn.Linear(before, after, bias=False), PointNorm(after), nn.ReLU()]
    return nn.Sequential(*layers)


def _head(out: int) -> nn.Sequential:
    """Return the layers of a crop's features, 256 to `out`."""
    return nn.Sequential(
        nn.Linear(256, 128), PointNorm(128), nn.ReLU(),
        nn.Linear(128, 128), PointNorm(128), nn.ReLU(),
        nn.Linear(128, out),
    )  # fmt: skip
