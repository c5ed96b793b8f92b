"""The training loss (Sec. III-E): consistency, affordance (Eq. 6) and symmetry (Eq. 7).

Every term is a mean over points where the paper has a sum, so the number of queried points does not
change the step. The weights of the terms are the paper's, except w^f (D. 96). `TrainConfig.loss`
chooses between the terms as printed and balanced terms.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from pipelines.configs import TrainConfig
from pipelines.configs.learning import LossVariant
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.network.model import Prediction
from pipelines.network.training.dense_error import (
    reflection_errors,
    reflection_extent,
    rotation_errors,
    rotation_extent,
)
from pipelines.network.training.matching import NUM_REFLECTIONS, match_reflections
from pipelines.network.training.region_batch import RegionBatch

# All constants here are chosen by eye.
# Added to the predicted affordance before Eq. 7 weights by it: a fresh network predicts 0.
WEIGHT_FLOOR = 0.1
# Divisor of the dense error, at least: this share of the object's size. Thin objects, which have
# mirror images close together, would otherwise outweigh all others.
MIN_EXTENT_SHARE = 0.3
MIN_EXTENT = 1e-6  # metres, added to this share, which is zero if all points are equal
GRASPABLE = 0.05  # affordance above which a point counts as positive
MAX_BALANCE = 4.0  # largest weight of a rare class relative to a common class
MIN_VARIANCE = 1e-6  # least variance of features, which may all be equal
RIGHT = 0.134  # largest relative error of a symmetry that is exact enough for grasps
NUM_ERROR_POINTS = 16  # points of the region on which dense errors are measured


def total_loss(
    prediction: Prediction,
    truth: RegionBatch,
    pair: tuple[Tensor, Tensor] | None,  # each (B / 2, Q, 128)
    config: TrainConfig,
    points: Tensor,  # (B, S, 3)
    labelled: Tensor | None = None,  # (B,)
) -> dict[str, Tensor]:
    """Return L = w^f L^f + w^a sum L^a + w^s sum L^s over one batch, `total`, and its terms.

    Args:
        prediction: prediction at the Q queried points.
        truth: labels of the same points.
        pair: features of points in the initial regions, the first half of the batch, and in their
            scaled copies, the second half; None without Siamese training.
        config: weights of the terms.
        points: points of the regions, metres, for the measurement of dense errors.
        labelled: 1 where labels hold, 0 where they are ignored; None if all labels hold.
    """
    if labelled is None:
        labelled = torch.ones_like(truth.ground)
    terms = _terms(config.loss)
    no_pair = prediction.features.new_zeros(())
    feature = no_pair if pair is None else terms.consistency(*pair)  # L^f
    affordance = terms.affordance(prediction.affordance, truth.affordance, labelled)  # Eq. 6
    weight = terms.weights(prediction.affordance)
    matched = match_reflections(
        truth, points, prediction.direction[:, :, :3], prediction.center[:, :, :3], weight
    )
    errors = slot_errors(prediction, matched, points)
    is_right = right_symmetries(errors) if config.existence == "right" else None

    def mean(of_points: Tensor) -> Tensor:  # (B, Q), weighted by a_j of Eq. 7
        return (weight * of_points).sum(-1) @ labelled / len(labelled)

    existence = mean(existence_loss(prediction.existence, matched, is_right))  # Eq. 7, first term
    parameters = mean((errors * matched.existence[:, None]).sum(-1))  # Eq. 7, second term
    symmetry = config.weight_existence * existence + config.weight_parameters * parameters
    total = (  # L of Sec. III-E
        config.weight_feature * feature
        + config.weight_affordance * affordance
        + config.weight_symmetry * symmetry
    )
    return {
        "total": total,
        "feature": feature,
        "affordance": affordance,
        "existence": existence,
        "parameters": parameters,
    }


class _Terms(NamedTuple):
    """The terms that a `LossVariant` computes differently."""

    consistency: Callable[[Tensor, Tensor], Tensor]  # L^f
    affordance: Callable[[Tensor, Tensor, Tensor], Tensor]  # L^a, Eq. 6
    weights: Callable[[Tensor], Tensor]  # a_j of Eq. 7


def _terms(variant: LossVariant) -> _Terms:
    """Return the terms as printed, or balanced (D. 113)."""
    if variant == "paper":
        return _Terms(plain_consistency, plain_affordance_loss, plain_weights)
    return _Terms(consistency_loss, affordance_loss, symmetry_weights)


def consistency_loss(
    features: Tensor,  # (B, Q, C)
    copy_features: Tensor,  # (B, Q, C)
) -> Tensor:
    """Return L^f: mean squared distance of a point's two features, divided by their variance.

    Without the division, features would become close by shrinking. The variance is over all points,
    a mean over channels (D. 96).
    """
    both = torch.cat([features, copy_features]).flatten(0, 1)
    return functional.mse_loss(features, copy_features) / (both.var(0).mean() + MIN_VARIANCE)


def plain_consistency(
    features: Tensor,  # (B, Q, C)
    copy_features: Tensor,  # (B, Q, C)
) -> Tensor:
    """Return L^f as printed, a mean over points: the squared distance of a point's two features."""
    return (features - copy_features).square().sum(-1).mean()


def plain_affordance_loss(
    predicted: Tensor,  # (B, Q)
    truth: Tensor,  # (B, Q)
    labelled: Tensor,  # (B,)
) -> Tensor:
    """Return the L1 of Eq. 6 as printed."""
    return ((predicted - truth).abs().mean(-1) @ labelled) / len(labelled)  # Eq. 6


def plain_weights(
    affordance: Tensor,  # (B, Q)
) -> Tensor:
    """Return a_j / Q of Eq. 7 without a gradient, which would reduce a_j without end."""
    return affordance.detach().clamp(0.0, 1.0) / affordance.shape[-1]


def affordance_loss(
    predicted: Tensor,  # (B, Q)
    truth: Tensor,  # (B, Q)
    labelled: Tensor | None = None,  # (B,)
) -> Tensor:
    """Return the L1 of Eq. 6 with equal weights of graspable and other points.

    The median minimises an L1, and is zero if few points are graspable. Therefore the positives and
    the negatives of the batch each get half of the weight, within `MAX_BALANCE`.
    """
    positive = (truth > GRASPABLE).to(truth.dtype)
    share = positive.mean()
    ratio = ((1.0 - share) / share).clamp(1.0 / MAX_BALANCE, MAX_BALANCE)
    weight = torch.where(positive > 0, ratio.sqrt(), 1.0 / ratio.sqrt())
    if labelled is not None:
        weight = weight * labelled[:, None]
    return ((predicted - truth).abs() * weight).sum() / weight.sum()  # Eq. 6


def symmetry_weights(
    affordance: Tensor,  # (B, Q)
) -> Tensor:
    """Return the weights of Eq. 7: a_j plus a floor, without a gradient, by their sum (D. 1).

    Rows sum to one, so that a sum by these weights is a mean over points.
    """
    weight = affordance.detach().clamp(0.0, 1.0) + WEIGHT_FLOOR
    return weight / weight.sum(-1, keepdim=True)


def existence_loss(
    logits: Tensor,  # (B, Q, 5)
    truth: RegionBatch,
    is_right: Tensor | None = None,  # (B, Q, 5)
) -> Tensor:
    """Return L_c of each point (B, Q): five binary cross-entropies, summed (D. 12).

    With `is_right`, a labelled symmetry exists only at points that predict it right.
    """
    target = truth.existence[:, None].expand_as(logits)
    if is_right is not None:
        target = target * is_right
    return functional.binary_cross_entropy_with_logits(logits, target, reduction="none").sum(-1)


def right_symmetries(
    errors: Tensor,  # (B, Q, 5)
) -> Tensor:
    """Return which of the `slot_errors` are below `RIGHT`; a sphere's error is squared."""
    limit = torch.full((errors.shape[-1],), RIGHT, device=errors.device, dtype=errors.dtype)
    limit[SPHERE_SLOT] = RIGHT**2
    return errors < limit


def slot_errors(
    prediction: Prediction,
    truth: RegionBatch,
    points: Tensor,  # (B, S, 3)
) -> Tensor:
    """Return the errors (B, Q, 5) of each point's symmetries; L_r sums over existing symmetries.

    Reflection and rotation: dense error relative to the true extent. Sphere: squared distance of
    the centre in units of the radius, dimensionless as the others.
    """
    size = (points - points.mean(1, keepdim=True)).norm(dim=-1).amax(-1)  # (B,)
    smallest = MIN_EXTENT_SHARE * size + MIN_EXTENT
    kinds = (reflection_errors, reflection_extent), (rotation_errors, rotation_extent)
    losses = []
    for slot in range(NUM_REFLECTIONS + 1):
        direction, center = truth.direction[:, slot], truth.center[:, slot]
        error, extent = kinds[slot == ROTATION_SLOT]
        predicted = prediction.direction[:, :, slot], prediction.center[:, :, slot]
        scale = torch.maximum(extent(points, direction, center), smallest)
        losses.append(error(points, *predicted, direction, center) / scale[:, None])
    center = truth.center[:, None, SPHERE_SLOT]
    radius = torch.maximum((points - center).norm(dim=-1).amax(-1), smallest)
    offset = prediction.center[:, :, SPHERE_SLOT] - center
    losses.append(offset.square().sum(-1) / radius[:, None].square())
    return torch.stack(losses, -1)
