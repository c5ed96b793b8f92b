"""Copies of trained networks for inference: no batch norms left, linear layers cloud by cloud.

After training, a batch norm is a fixed a x + b for each channel, and a linear layer or convolution
before a batch norm is equal to a layer with other weights and no norm. The linear layers of the
grasp network become layers of `cloudwise`, with results independent of the batch (D. 61).
"""

import copy
from itertools import pairwise
from typing import TypeVar, cast

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval
from torchvision.models.resnet import Bottleneck

from pipelines.array_types import Floats, Indices
from pipelines.geometry.numerics.compiled import compiled
from pipelines.network.cpu.cloudwise import CloudChain, CloudLinear, RowLinear, taken_apart
from pipelines.network.heads import Heads
from pipelines.network.pift import PIFT, ConvolutionPIFT
from pipelines.network.pointnet2 import FeaturePropagation, PointNorm, SetAbstraction
from pipelines.network.sampling import interpolation_weights, weighted_sum

Network = TypeVar("Network", bound=nn.Module)


@torch.no_grad()
def folded(network: Network) -> Network:
    """Return a copy of a trained network, for inference alone, with the same outputs."""
    network = copy.deepcopy(network).eval().requires_grad_(False)
    for module in network.modules():
        if isinstance(module, SetAbstraction | FeaturePropagation | PIFT | ConvolutionPIFT | Heads):
            _make_cloudwise(module)
    for module in list(network.modules()):
        if isinstance(module, SetAbstraction):
            _fold_last(module.point)
        elif isinstance(module, nn.Sequential | nn.ModuleDict | Bottleneck):
            _fold_convolutions(module)
        elif isinstance(module, nn.ReLU):
            module.inplace = True
        for name, part in module.named_children():
            if isinstance(part, FeaturePropagation):
                setattr(module, name, _folded_propagation(part))
            elif isinstance(part, nn.Sequential) and any(type(x) is CloudLinear for x in part):
                setattr(module, name, _chained(part))
    return network


def _make_cloudwise(part: nn.Module) -> None:
    """Let the linear layers of `part` give each cloud, or each row, the same bits in any batch."""
    is_pift = isinstance(part, PIFT | ConvolutionPIFT)
    of_one_row = {id(part.hidden), id(part.regress)} if is_pift else set()
    for layer in part.modules():
        if type(layer) is nn.Linear:  # the class alone decides how a layer is computed
            single = layer.out_features == 1 or id(layer) in of_one_row
            layer.__class__ = RowLinear if single else CloudLinear


class FoldedPropagation(nn.Module):
    """A feature propagation with its norms folded into its linear layers."""

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
        index, weight = interpolation_weights(points, coarse_points)
        coarse = self.coarse(coarse_features)
        if not taken_apart(features):
            interpolated = weighted_sum(coarse, index, weight)
            made: Tensor = self.joined(torch.relu(interpolated + self.fine(features)))
            return made
        found: Tensor = coarse.new_empty(*features.shape[:2], self.joined.out_features)
        near = zip(*(each.numpy() for each in (coarse, index, weight)), strict=True)
        for cloud, out, (rows, places, weights) in zip(features, found, near, strict=True):
            hidden = self.fine.of_cloud(cloud)
            add_interpolated(rows, places, weights, hidden.numpy())
            out.copy_(self.joined.of_cloud(hidden))
        return found


@compiled
def add_interpolated(coarse: Floats, places: Indices, weights: Floats, fine: Floats) -> None:
    """Add to `fine` (m, c) weighted sums of rows (n, c) of `coarse`, and clip it at zero.

    `places` and `weights` are (m, 3).
    """
    least = fine.dtype.type(0.0)
    for m in range(len(fine)):
        i, j, k = places[m, 0], places[m, 1], places[m, 2]
        u, v, w = weights[m, 0], weights[m, 1], weights[m, 2]
        for c in range(fine.shape[1]):
            value = u * coarse[i, c] + v * coarse[j, c] + w * coarse[k, c] + fine[m, c]
            fine[m, c] = least if value < least else value


def _folded_propagation(propagation: FeaturePropagation) -> FoldedPropagation:
    """Fold the norms; the norm of a sum of two linear layers goes into both layers."""
    first, _, joined, last = propagation.joined
    scale, shift = _affine(cast(PointNorm, first))
    _scale(propagation.coarse, scale, None)
    _scale(propagation.fine, scale, shift)
    _scale(cast(nn.Linear, joined), *_affine(cast(PointNorm, last)))
    coarse, fine, joined = (
        cast(CloudLinear, each) for each in (propagation.coarse, propagation.fine, joined)
    )
    return FoldedPropagation(coarse, fine, joined)


def _chained(layers: nn.Sequential) -> nn.Sequential:
    """Return the layers with runs of linear layers as chains, each with the following ReLU."""
    parts: list[nn.Module] = []
    run: list[nn.Module] = []
    for layer in layers:
        if isinstance(layer, CloudLinear):
            run.append(layer)
        elif isinstance(layer, nn.ReLU) and run:
            cast(CloudLinear, run[-1]).rectifies = True
        else:
            parts += [CloudChain(*run), layer] if run else [layer]
            run = []
    return nn.Sequential(*parts, CloudChain(*run)) if run else nn.Sequential(*parts)


def _fold_last(layers: nn.Sequential) -> None:
    """Fold the norm at the end into the linear layer before it."""
    *_, linear, norm = layers
    scale, shift = _affine(cast(PointNorm, norm))
    _scale(cast(nn.Linear, linear), scale, shift)
    layers[len(layers) - 1] = nn.Identity()


def _affine(norm: PointNorm) -> tuple[Tensor, Tensor]:
    """Return the factor and the summand of a trained norm, a number for each channel."""
    mean, variance = cast(Tensor, norm.running_mean), cast(Tensor, norm.running_var)
    scale = norm.weight / (variance + norm.eps).sqrt()
    return scale, norm.bias - mean * scale


def _scale(linear: nn.Linear, scale: Tensor, shift: Tensor | None) -> None:
    linear.weight.mul_(scale[:, None])
    if shift is not None:
        linear.bias.mul_(scale).add_(shift)


def _fold_convolutions(layers: nn.Module) -> None:
    """Fold each batch norm that follows a convolution into the convolution.

    `layers` run in their order, as in torchvision; the body of its ResNet is a `ModuleDict`.
    """
    for (first, layer), (second, norm) in pairwise(list(layers.named_children())):
        if isinstance(layer, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
            setattr(layers, first, fuse_conv_bn_eval(layer, norm))
            setattr(layers, second, nn.Identity())
