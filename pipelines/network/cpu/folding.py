"""Trained networks made cheaper to run: batch norms become part of the linear layers before them.

Once trained, a batch norm is a fixed a x + b for each channel, and a linear layer or convolution
followed by one is a linear layer or convolution with other weights. Gradients are of no use then.
"""

import copy
from itertools import pairwise
from typing import TypeVar, cast

import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval
from torchvision.models.resnet import Bottleneck

from pipelines.network.cpu.cloudwise import CloudChain, CloudLinear
from pipelines.network.pointnet2 import (
    FeaturePropagation,
    FoldedPropagation,
    PointNorm,
    SetAbstraction,
)

Network = TypeVar("Network", bound=nn.Module)


@torch.no_grad()
def folded(network: Network) -> Network:
    """Return a copy of a trained network, for inference alone, that says the same."""
    network = copy.deepcopy(network).eval().requires_grad_(False)
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


def _folded_propagation(propagation: FeaturePropagation) -> FoldedPropagation:
    """Fold the norms: that of a sum of two linear layers goes into both of them."""
    first, _, joined, last = propagation.joined
    scale, shift = _affine(cast(PointNorm, first))
    _scale(propagation.coarse, scale, None)
    _scale(propagation.fine, scale, shift)
    _scale(cast(nn.Linear, joined), *_affine(cast(PointNorm, last)))
    return FoldedPropagation(propagation.coarse, propagation.fine, cast(CloudLinear, joined))


def _chained(layers: nn.Sequential) -> nn.Sequential:
    """Return the layers with runs of linear ones as chains, each with the ReLU that follows it."""
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
    """Return what a trained norm multiplies by and what it adds, a number each channel."""
    mean, variance = cast(Tensor, norm.running_mean), cast(Tensor, norm.running_var)
    scale = norm.weight / (variance + norm.eps).sqrt()
    return scale, norm.bias - mean * scale


def _scale(linear: nn.Linear, scale: Tensor, shift: Tensor | None) -> None:
    linear.weight.mul_(scale[:, None])
    if shift is not None:
        linear.bias.mul_(scale).add_(shift)


def _fold_convolutions(layers: nn.Module) -> None:
    """Fold each batch norm that follows a convolution into it.

    `layers` run in their order, as torchvision's do; its ResNet's body is a `ModuleDict`.
    """
    for (first, layer), (second, norm) in pairwise(list(layers.named_children())):
        if isinstance(layer, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
            setattr(layers, first, fuse_conv_bn_eval(layer, norm))
            setattr(layers, second, nn.Identity())
