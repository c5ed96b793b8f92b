"""Backbone of the light detector: a narrow residual network with a feature pyramid."""

from collections import OrderedDict

import torch
from torch import Tensor, nn
from torchvision.ops.feature_pyramid_network import FeaturePyramidNetwork, LastLevelMaxPool

WIDTHS = (24, 48, 96, 160, 192)  # of the stem and of the stages at strides 4, 8, 16, 32
BLOCKS = (1, 2, 2, 2)


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions beside a shortcut."""

    def __init__(self, in_dim: int, out_dim: int, stride: int) -> None:
        super().__init__()
        self.first = convolution(in_dim, out_dim, 3, stride)
        self.second = convolution(out_dim, out_dim, 3, 1)
        same = in_dim == out_dim and stride == 1
        self.shortcut = nn.Identity() if same else convolution(in_dim, out_dim, 1, stride)

    def forward(
        self,
        image: Tensor,  # (B, C, h, w)
    ) -> Tensor:
        """Return the block's output, `stride` times smaller."""
        # In place: fresh memory for maps this large takes as long as the arithmetic on them.
        summed = self.second(self.first(image).relu_()).add_(self.shortcut(image))
        return torch.relu_(summed)


class LightBackbone(nn.Module):
    """Feature maps of `out_channels` channels at strides 4 to 64, named as RoI heads expect."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.out_channels = out_channels
        self.stem = convolution(in_channels, WIDTHS[0], 3, 2)
        stages = []
        for i, blocks in enumerate(BLOCKS):
            dims = [WIDTHS[i], *[WIDTHS[i + 1]] * blocks]
            layers = [ResidualBlock(dims[j], dims[j + 1], 2 - min(j, 1)) for j in range(blocks)]
            stages.append(nn.Sequential(*layers))
        self.stages = nn.ModuleList(stages)
        self.pyramid = FeaturePyramidNetwork(
            list(WIDTHS[1:]), out_channels, extra_blocks=LastLevelMaxPool()
        )

    def forward(
        self,
        image: Tensor,  # (B, C, h, w)
    ) -> dict[str, Tensor]:
        """Return the pyramid's maps, finest first."""
        maps: OrderedDict[str, Tensor] = OrderedDict()
        image = torch.relu_(self.stem(image))
        for i, stage in enumerate(self.stages):
            image = stage(image)
            maps[str(i)] = image
        pyramid: dict[str, Tensor] = self.pyramid(maps)
        return pyramid


def convolution(in_dim: int, out_dim: int, size: int, stride: int) -> nn.Sequential:
    """Return a convolution with batch norm, its output `stride` times smaller."""
    return nn.Sequential(
        nn.Conv2d(in_dim, out_dim, size, stride, padding=size // 2, bias=False),
        nn.BatchNorm2d(out_dim),
    )
