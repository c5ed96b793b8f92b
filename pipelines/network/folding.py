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

from pipelines.network.pointnet2 import FeaturePropagation, PointNorm, SetAbstraction

Network = TypeVar("Network", bound=nn.Module)


@torch.no_grad()
def folded(network: Network) -> Network:
    """Return a copy of a trained network, for inference alone, that says the same."""
    network = copy.deepcopy(network).eval().requires_grad_(False)
    for module in network.modules():
        if isinstance(module, SetAbstraction):
            _fold_last(module.point)
        elif isinstance(module, FeaturePropagation):
            _fold_first(module)
            _fold_last(module.joined)
        elif isinstance(module, nn.Sequential | nn.ModuleDict | Bottleneck):
            _fold_convolutions(module)
        elif isinstance(module, nn.ReLU):
            module.inplace = True
    return network


def _fold_last(layers: nn.Sequential) -> None:
    """Fold the norm at the end into the linear layer before it."""
    *_, linear, norm = layers
    scale, shift = _affine(cast(PointNorm, norm))
    _scale(cast(nn.Linear, linear), scale, shift)
    layers[len(layers) - 1] = nn.Identity()


def _fold_first(propagation: FeaturePropagation) -> None:
    """Fold the norm of a sum of two linear layers into both of them."""
    scale, shift = _affine(cast(PointNorm, propagation.joined[0]))
    _scale(propagation.coarse, scale, None)
    _scale(propagation.fine, scale, shift)
    propagation.joined[0] = nn.Identity()


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
