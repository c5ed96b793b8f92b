"""Backbones of the light detector: narrow residual networks with a feature pyramid."""

from collections import OrderedDict
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torchvision.ops.feature_pyramid_network import FeaturePyramidNetwork, LastLevelMaxPool

WIDTHS = (24, 48, 96, 160, 192)  # channels of the stem and of the stages at strides 4, 8, 16, 32
COLOR_WIDTHS = (16, 32, 64, 96, 96)  # channels of the colour stream, next to the geometry stream
BLOCKS = (1, 2, 2, 2)


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions with a shortcut."""

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
        # In place: new memory for maps this large takes as long as the arithmetic.
        summed = self.second(self.first(image).relu_()).add_(self.shortcut(image))
        return torch.relu_(summed)


class ResidualStream(nn.Module):
    """A stem and four stages of residual blocks, at strides 4, 8, 16 and 32."""

    def __init__(self, in_channels: int, widths: Sequence[int] = WIDTHS) -> None:
        super().__init__()
        self.stem = convolution(in_channels, widths[0], 3, 2)
        stages = []
        for i, blocks in enumerate(BLOCKS):
            dims = [widths[i], *[widths[i + 1]] * blocks]
            strides = [2] + [1] * (blocks - 1)  # a stage's first block halves the map
            layers = map(ResidualBlock, dims[:-1], dims[1:], strides)
            stages.append(nn.Sequential(*layers))
        self.stages = nn.ModuleList(stages)

    def maps(
        self,
        image: Tensor,  # (B, C, h, w)
    ) -> list[Tensor]:
        """Return the output of each stage, finest first."""
        found, image = [], torch.relu_(self.stem(image))
        for stage in self.stages:
            image = stage(image)
            found.append(image)
        return found


class LightBackbone(ResidualStream):
    """Feature maps of `out_channels` channels at strides 4 to 64, named as RoI heads expect."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__(in_channels)
        self.out_channels = out_channels
        self.pyramid = FeaturePyramidNetwork(
            list(WIDTHS[1:]), out_channels, extra_blocks=LastLevelMaxPool()
        )

    def forward(
        self,
        image: Tensor,  # (B, C, h, w)
    ) -> dict[str, Tensor]:
        """Return the pyramid's maps, finest first."""
        named = {str(i): each for i, each in enumerate(self.maps(image))}
        pyramid: dict[str, Tensor] = self.pyramid(OrderedDict(named))
        return pyramid


class TwoStreamBackbone(LightBackbone):
    """A `LightBackbone` of geometry, joined by a narrower colour stream before the pyramid.

    The joining layers start at zero: with the weights of a detector of geometry, the two streams
    have the same output as this detector, independent of the colours.
    """

    def __init__(self, color_channels: int, geometry_channels: int, out_channels: int) -> None:
        super().__init__(geometry_channels, out_channels)
        self.color_channels = color_channels
        self.color = ResidualStream(color_channels, COLOR_WIDTHS)
        pairs = zip(COLOR_WIDTHS[1:], WIDTHS[1:], strict=True)
        self.joins = nn.ModuleList(nn.Conv2d(color, own, 1) for color, own in pairs)
        for weights in self.joins.parameters():
            nn.init.zeros_(weights)

    def maps(
        self,
        image: Tensor,  # (B, C, h, w): colour, then geometry
    ) -> list[Tensor]:
        """Return the output of each stage of both streams, finest first."""
        colors = self.color.maps(image[:, : self.color_channels])
        shapes = super().maps(image[:, self.color_channels :])
        joined = zip(shapes, colors, self.joins, strict=True)
        return [shape + join(color) for shape, color, join in joined]


def convolution(in_dim: int, out_dim: int, size: int, stride: int) -> nn.Sequential:
    """Return a convolution with batch norm, its output `stride` times smaller."""
    return nn.Sequential(
        nn.Conv2d(in_dim, out_dim, size, stride, padding=size // 2, bias=False),
        nn.BatchNorm2d(out_dim),
    )
