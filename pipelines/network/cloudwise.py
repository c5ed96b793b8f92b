"""Layers that tell the same of a cloud whatever else is in its batch, to the last bit (D. 61)."""

from typing import cast

import torch
from torch import Tensor, nn


class CloudLinear(nn.Linear):
    """A linear layer of the points of several clouds.

    A product of matrices sums few rows in another order than many, and the last ones in another
    than the first, as the processor likes; and a last bit decides which points are sampled. So on a
    CPU, without gradients, each cloud is a product of its own.
    """

    def forward(
        self,
        features: Tensor,  # (B, ..., C)
    ) -> Tensor:
        """Return features (B, ..., out)."""
        if torch.is_grad_enabled() or features.device.type != "cpu":
            return super().forward(features)
        found = features.new_empty((*features.shape[:-1], self.out_features))
        weight, bias = self.weight.t(), cast("Tensor | None", self.bias)
        for cloud, out in zip(features.flatten(1, -2), found.flatten(1, -2), strict=True):
            if bias is None:
                torch.mm(cloud, weight, out=out)
            else:
                torch.addmm(bias, cloud, weight, out=out)
        return found


class RowLinear(nn.Linear):
    """A linear layer that sums each row in the same order, wherever it stands among others.

    For one row a cloud, or one number a row: a product of matrices sums a single row, and the last
    rows of a product with a vector, in an order of their own.
    """

    def forward(
        self,
        features: Tensor,  # (..., C)
    ) -> Tensor:
        """Return features (..., out)."""
        return (features[..., None, :] * self.weight).sum(-1) + self.bias
