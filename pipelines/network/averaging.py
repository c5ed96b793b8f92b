"""Means of the symmetries that the points of a region predict, one a slot, in torch (D. 4)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from pipelines.network.model import Prediction


@dataclass(frozen=True)
class MeanSymmetries:
    """Symmetries of B regions, in the frame and unit of the prediction.

    Attributes:
        existence: (B, 5) probabilities.
        center: (B, 5, 3).
        direction: (B, 5, 3) unit; any for the sphere.
    """

    existence: Tensor
    center: Tensor
    direction: Tensor


@torch.no_grad()
def average_symmetries(
    prediction: Prediction,
    weight: Tensor,  # (B, Q)
) -> MeanSymmetries:
    """Return the mean over the Q points by `weight`, whose rows sum to one.

    n and -n are one plane: directions are averaged as outer products, of whose sum the leading
    eigenvector is taken. Centres are weighted medians, coordinate by coordinate.
    """
    existence = (torch.sigmoid(prediction.existence) * weight[..., None]).sum(1)
    weighted = prediction.direction * weight[..., None, None]
    outer = torch.einsum("bqki,bqkj->bkij", weighted, prediction.direction)
    direction = torch.linalg.eigh(outer).eigenvectors[..., -1]
    return MeanSymmetries(existence, weighted_median(prediction.center, weight), direction)


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
