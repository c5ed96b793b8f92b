"""Random views of a region: whole-cloud augmentation, and the scaled copy for Siamese training.

Labels follow exactly: planes and axes turn with the cloud, and a scaling is only drawn along a
direction that leaves every symmetry of the region a symmetry (Sec. III-E, "principal").
Each region draws from its own generator, independent of the batch.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from pipelines.configs import AugmentationConfig
from pipelines.geometry.symmetry import ROTATION_SLOT, SPHERE_SLOT
from pipelines.network.training.region_batch import RegionBatch

# Cosine below which two directions count as perpendicular; they count as parallel if it is within
# the square of this number of 1, at up to 2.4 degrees.
ALIGNMENT = 0.03
LEAST_CROSS = 0.1  # length of a cross product of unit vectors; shorter ones have no sure direction

Generators = Sequence[np.random.Generator]  # one per region


def augment(batch: RegionBatch, config: AugmentationConfig, generators: Generators) -> RegionBatch:
    """Return the regions turned, tilted, mirrored, scaled and jittered at random.

    Turns are about the third axis, tilts about the others, and the mirror swaps left and right,
    the first axis of both input frames. Small scalings are uniform, since widths are metric.
    """
    spread = torch.tensor([config.tilt_deg, config.tilt_deg, config.turn_deg])
    turn = _rotations(_normal(generators, 3) * spread * (math.pi / 180.0))
    drawn = _uniform(generators, 2)
    mirror = torch.where(drawn[:, 0] < config.mirrored, -1.0, 1.0)
    flip = torch.diag_embed(torch.stack([mirror, *[torch.ones_like(mirror)] * 2], -1))
    scale = 1.0 + config.scale * (2.0 * drawn[:, 1] - 1.0)
    isometry = turn @ flip
    moved = batch.mapped(isometry * scale[:, None, None], isometry)
    noise = _normal(generators, *batch.points.shape[1:])
    return replace(moved, points=moved.points + config.jitter * noise)


def scaled_copy(
    batch: RegionBatch, config: AugmentationConfig, generators: Generators
) -> RegionBatch:
    """Return the regions scaled along or across one principal direction each (Fig. 3).

    A plane allows any direction along or across its normal. A rotation stays a symmetry only if the
    direction is its axis, so that both directions across the axis share one scale. A sphere becomes
    an ellipsoid: the features of its points should not change, but its labels no longer hold.
    """
    direction, keeps = principal_directions(batch, generators)
    limit, drawn = math.log(config.principal_scale), _uniform(generators, 2)
    factor = torch.exp(limit * (2.0 * drawn[:, 0] - 1.0) * keeps)
    along = drawn[:, 1] < 0.5
    one = torch.ones_like(factor)
    outer = direction[:, :, None] * direction[:, None]
    scaling = torch.where(along, factor, one)[:, None, None] * outer + torch.where(
        along, one, factor
    )[:, None, None] * (torch.eye(3) - outer)
    # Normals and axes are eigenvectors of the scaling and keep their directions.
    return batch.mapped(scaling, torch.eye(3).expand_as(scaling))


def principal_directions(batch: RegionBatch, generators: Generators) -> tuple[Tensor, Tensor]:
    """Return a random direction (B, 3) along which scaling keeps all planes and axes.

    Candidates are the normals and the axis, the cross products of two normals, and a random
    direction across the first normal, or across the axis. A region with neither, such as a sphere,
    gets a random direction. Measured symmetries may fit each other so badly that no direction keeps
    all: then the second result (B,) is false.
    """
    directions = batch.direction[:, :SPHERE_SLOT]  # (B, 4, 3)
    exists = batch.existence[:, :SPHERE_SLOT] > 0  # (B, 4)
    random = functional.normalize(_normal(generators, 3), dim=-1)
    first = directions.gather(
        1, exists.float().argmax(1)[:, None, None].expand(-1, 1, 3)
    )  # (B, 1, 3)
    candidates = torch.cat(
        [
            directions,
            torch.linalg.cross(directions[:, [0, 0, 1]], directions[:, [1, 2, 2]]),
            torch.linalg.cross(first, random[:, None]),
        ],
        1,
    )
    length = candidates.norm(dim=-1, keepdim=True)  # (B, candidate, 1)
    candidates = candidates / length.clamp(min=LEAST_CROSS)
    cosine = (candidates @ directions.transpose(1, 2)).abs()  # (B, candidate, slot)
    keeps = (cosine < ALIGNMENT) | (cosine > 1.0 - ALIGNMENT**2)
    keeps[..., ROTATION_SLOT] = cosine[..., ROTATION_SLOT] > 1.0 - ALIGNMENT**2
    valid = (keeps | ~exists[:, None]).all(-1) & (length[..., 0] > LEAST_CROSS)
    valid &= exists.any(-1)[:, None]
    # A valid candidate, drawn by its number among the valid ones; any if none is valid.
    number = (_uniform(generators, 1) * valid.sum(1, keepdim=True)).floor()
    chosen = ((valid.cumsum(1) > number) & valid).float().argmax(1)
    picked = candidates.gather(1, chosen[:, None, None].expand(-1, 1, 3))[:, 0]
    keeps_all = valid.any(-1) | ~exists.any(-1)
    return torch.where(valid.any(-1)[:, None], picked, random), keeps_all


def _normal(generators: Generators, *shape: int) -> Tensor:
    """Return normally distributed numbers (B, *shape)."""
    drawn = [each.standard_normal(shape, np.float32) for each in generators]
    return torch.from_numpy(np.stack(drawn))


def _uniform(generators: Generators, count: int) -> Tensor:
    """Return numbers (B, count) in [0, 1)."""
    return torch.from_numpy(np.stack([each.random(count, np.float32) for each in generators]))


def _rotations(
    vectors: Tensor,  # (B, 3)
) -> Tensor:
    """Return the rotations (B, 3, 3) of rotation vectors in radians."""
    x, y, z = vectors.unbind(-1)
    zero = torch.zeros_like(x)
    skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).view(-1, 3, 3)
    rotations: Tensor = torch.linalg.matrix_exp(skew)
    return rotations
