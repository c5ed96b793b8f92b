"""Maximum over a group of points, with a cheaper backward pass."""

from typing import Any

import torch
from torch import Tensor


class _Maximum(torch.autograd.Function):
    """Maximum over the last axis but one; the gradient goes to every element that attains it.

    torch's own backward divides the gradient among ties, which costs two more passes over the
    largest tensor of the network. Ties only arise from repeated points, which would then count as
    often as they are repeated; training moves them apart (`AugmentationConfig.jitter`).
    """

    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:  # noqa: ANN401 - torch's context object
        maximum = values.amax(-2)
        ctx.save_for_backward(values, maximum)
        return maximum

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:  # noqa: ANN401 - as above
        values, maximum = ctx.saved_tensors
        # Compared into floats: a product of booleans and floats is ten times slower on the CPU.
        attained = torch.empty_like(values)
        torch.eq(values, maximum[..., None, :], out=attained)
        return attained.mul_(gradients[0][..., None, :])


def fast_maximum(
    values: Tensor,  # (..., K, C)
) -> Tensor:
    """Return (..., C), as `network.sampling.maximum` does."""
    found: Tensor = _Maximum.apply(values)
    return found
