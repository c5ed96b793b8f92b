"""Means of the symmetries that the points of a region predict, one a slot, in torch (D. 4)."""

import torch
from torch import Tensor

from pipelines.network.model import Prediction


@torch.no_grad()
def average_symmetries(
    prediction: Prediction,
    weight: Tensor,  # (B, Q)
) -> tuple[Tensor, Tensor, Tensor]:
    """Return mean existence (B, 5) as probabilities, centre (B, 5, 3) and unit direction (B, 5, 3).

    Over the Q points by `weight`, whose rows sum to one; frame and unit are the prediction's.

    n and -n are one plane: directions are averaged as outer products, of whose sum the leading
    eigenvector is taken. Centres are weighted medians, coordinate by coordinate.
    """
    existence = (torch.sigmoid(prediction.existence) * weight[..., None]).sum(1)
    weighted = prediction.direction * weight[..., None, None]
    outer = torch.einsum("bqki,bqkj->bkij", weighted, prediction.direction)
    direction = torch.linalg.eigh(outer).eigenvectors[..., -1]
    return existence, weighted_median(prediction.center, weight), direction


def weighted_median(
    values: Tensor,  # (B, Q, K, 3)
    weight: Tensor,  # (B, Q)
) -> Tensor:
    """Return the value (B, K, 3) at which half of the weight is reached."""
    ordered, order = values.sort(dim=1)
    spread = weight[:, :, None, None].expand_as(values).gather(1, order)
    half = 0.5 * weight.sum(1)[:, None, None, None]
    at = (spread.cumsum(1) < half).sum(1, keepdim=True).clamp(max=values.shape[1] - 1)
    return ordered.gather(1, at)[:, 0]
