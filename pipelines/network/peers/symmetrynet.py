"""SymmetryNet: at each point of a region, its mirror images, its foot on the axis, the centre.

Shi et al.: SymmetryNet, SIGGRAPH Asia 2020. Layers are as in the authors' release of 24,728,510
parameters, with a PSPNet on ResNet-18 without batch norms for colours. Two parts are left out, the
unused classifier of PSPNet (71,189) and the weights of points by their index (1,000; here a mean);
the fourth mode, the sphere, is added (129). The light variant has a small network for colours and
heads of half the width. Points are relative to their mean; points and offsets are in
units of an object's size, where the original has metres in the camera frame.
"""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipelines.configs.peers import PeerNetworkConfig
from pipelines.network.peers.symmetrynet_input import CROP_SIDE
from pipelines.network.training.matching import NUM_REFLECTIONS

SYMMETRY_MODES = ("plane", "axis", "both", "sphere")
COLOR_DIM = 32
UNIT = 0.05  # metres, about an object's size: unit of points, predicted offsets and their loss
LENGTHS = ("center", "mirrored", "feet", "axis_foot")  # outputs in `UNIT`


@dataclass(frozen=True)
class SymmetryNetSizes:
    """Points of a region, and widths of layers: for points, for colours, for both, of the heads."""

    num_points: int
    of_points: tuple[int, int]
    of_colors: tuple[int, int]
    joined: tuple[int, int]
    head: tuple[int, int, int]


SYMMETRYNET_SIZES = {
    "light": SymmetryNetSizes(500, (32, 64), (32, 64), (256, 512), (320, 128, 64)),
    "full": SymmetryNetSizes(1000, (64, 128), (64, 128), (512, 1024), (640, 256, 128)),
}


@dataclass(frozen=True)
class SymmetryOutput:
    """Predictions of each of N points of a region; offsets are from the point, metres.

    Attributes:
        center: (B, N, 3) offset to the centre.
        mirrored: (B, N, 3, 3) offsets to the point's images across three planes.
        feet: (B, N, 3, 3) offsets to the point's feet on the planes.
        axis_foot: (B, N, 3) offset to the point's foot on the axis.
        existence: (B, N, 3) probabilities of the planes.
        mode: (B, N, 4) logits of `SYMMETRY_MODES`.
    """

    center: Tensor
    mirrored: Tensor
    feet: Tensor
    axis_foot: Tensor
    existence: Tensor
    mode: Tensor


class SymmetryNet(nn.Module):
    """Network from the colours and points of regions to the symmetries that each point predicts."""

    unit: Tensor  # metres; stored with the weights, so that weights learned in metres are refused

    def __init__(self, config: PeerNetworkConfig) -> None:
        super().__init__()
        self.config, self.sizes = config, SYMMETRYNET_SIZES[config.variant]
        self.register_buffer("unit", torch.tensor(UNIT))
        sizes = self.sizes
        self.colors = PSPNet() if config.variant == "full" else _light_colors()
        points, colors = (_steps(*sizes.of_points, first=3), _steps(*sizes.of_colors, first=32))
        self.of_points, self.of_colors = nn.ModuleList(points), nn.ModuleList(colors)
        both = sizes.of_points[1] + sizes.of_colors[1]
        self.joined = nn.Sequential(*_steps(*sizes.joined, first=both))
        width = sizes.of_points[1] + both + sizes.joined[1]
        outs = {"center": 3, "mirrored": 9, "feet": 9, "axis_foot": 3, "existence": 3}
        outs["mode"] = len(SYMMETRY_MODES)
        self.heads = nn.ModuleDict(
            {
                name: nn.Sequential(
                    *_steps(*sizes.head, first=width), nn.Linear(sizes.head[-1], out)
                )
                for name, out in outs.items()
            }
        )

    def forward(
        self,
        crop: Tensor,  # (B, 3, S, S) normalised colours
        pixels: Tensor,  # (B, N, 2) columns and rows of the points in the crop
        points: Tensor,  # (B, N, 3) metres, camera frame
    ) -> SymmetryOutput:
        """Return the predictions of each point."""
        found = self.colors(crop)
        column, row = (pixels.long() * found.shape[-1] // CROP_SIDE).unbind(-1)
        index = (row * found.shape[-1] + column)[:, None].expand(-1, COLOR_DIM, -1)
        color = found.flatten(2).gather(2, index).transpose(1, 2)
        point = self.of_points[0]((points - points.mean(dim=1, keepdim=True)) / self.unit)
        color = self.of_colors[0](color)
        point_after, color_after = self.of_points[1](point), self.of_colors[1](color)
        both = torch.cat([point_after, color_after], dim=-1)
        whole = self.joined(both).mean(dim=1, keepdim=True).expand(-1, both.shape[1], -1)
        each = torch.cat([point, color, both, whole], dim=-1)
        output = {name: head(each).float() for name, head in self.heads.items()}
        output |= {name: self.unit * output[name] for name in LENGTHS}
        planes = (*points.shape[:2], NUM_REFLECTIONS, 3)
        output["mirrored"], output["feet"] = (output[n].view(planes) for n in ("mirrored", "feet"))
        output["existence"] = output["existence"].sigmoid()
        return SymmetryOutput(**output)


class PSPNet(nn.Module):
    """ResNet-18 at an eighth of the size, pooled at four scales, then enlarged to full size."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            nn.Conv2d(3, 64, 7, 2, 3, bias=False), nn.ReLU(), nn.MaxPool2d(3, 2, 1)
        )
        blocks = []
        layers = ((64, 64, 1, 1), (64, 128, 2, 1), (128, 256, 1, 2), (256, 512, 1, 4))
        for before, after, stride, dilation in layers:
            blocks += [_Block(before, after, stride, 1), _Block(after, after, 1, dilation)]
        self.blocks = nn.Sequential(*blocks)
        self.pools = nn.ModuleList(
            nn.Sequential(nn.AdaptiveAvgPool2d(size), nn.Conv2d(512, 512, 1, bias=False))
            for size in (1, 2, 3, 6)
        )
        self.bottleneck = nn.Conv2d(5 * 512, 1024, 1)
        self.up = nn.Sequential(*(_up(*each) for each in pairwise((1024, 256, 64, 64))))
        self.last = nn.Conv2d(64, COLOR_DIM, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Return log-probabilities (B, 32, S, S) at the pixels of `image` (B, 3, S, S)."""
        found = self.blocks(self.stem(image))
        size = found.shape[2:]
        pooled = [
            functional.interpolate(pool(found), size, mode="bilinear", align_corners=False)
            for pool in self.pools
        ]
        merged = self.bottleneck(torch.cat([*pooled, found], dim=1)).relu()
        return functional.log_softmax(self.last(self.up(merged)), dim=1)


class _Block(nn.Module):
    """Two convolutions added to their input; initially they add nothing."""

    def __init__(self, before: int, after: int, stride: int, dilation: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(before, after, 3, stride, dilation, dilation, bias=False)
        self.second = nn.Conv2d(after, after, 3, 1, dilation, dilation, bias=False)
        nn.init.kaiming_normal_(self.first.weight, mode="fan_out", nonlinearity="relu")
        nn.init.zeros_(self.second.weight)
        same = stride == 1 and before == after
        self.skip = nn.Identity() if same else nn.Conv2d(before, after, 1, stride, bias=False)

    def forward(self, found: Tensor) -> Tensor:
        changed: Tensor = self.second(self.first(found).relu()) + self.skip(found)
        return changed.relu()


def _light_colors() -> nn.Sequential:
    """Return three convolutions that halve the size and two that double it."""
    layers: list[nn.Module] = []
    for before, after in pairwise((3, 32, 64, 128)):
        layers += [nn.Conv2d(before, after, 3, 2, 1), nn.ReLU()]
    layers += [_up(128, 64), _up(64, COLOR_DIM)]
    return nn.Sequential(*layers, nn.Conv2d(COLOR_DIM, COLOR_DIM, 1), nn.LogSoftmax(dim=1))


def _up(before: int, after: int) -> nn.Sequential:
    """Return a layer that doubles the size."""
    double = nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False)
    return nn.Sequential(double, nn.Conv2d(before, after, 3, padding=1), nn.PReLU())


def _steps(*widths: int, first: int) -> list[nn.Module]:
    """Return layers that all points share, from `first` through `widths`."""
    pairs = pairwise((first, *widths))
    return [nn.Sequential(nn.Linear(before, after), nn.ReLU()) for before, after in pairs]
