"""The heads: affordance, existence and symmetry parameters of each point (Fig. 5)."""

from functools import reduce
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipelines.geometry.symmetry import NUM_SLOTS

# Widths of hidden layers, of which the paper gives the number: of affordance and existence, and of
# the parameters.
HIDDEN, PARAMETER_HIDDEN = (64, 32, 16), (128, 96, 64)
NUM_DIRECTIONS = 4  # slots with a direction: all but the sphere
FIRST_OUTPUTS = 0.3  # scale of the last layers' first weights, relative to Kaiming's
POWER_STEPS = 4  # squarings: the second eigenvalue's ratio to the first fades to its 16th power
# Of a matrix with six numbers of unit length, eigenvalues are -1.3 to 1.3, the largest at least
# -0.58: shifted, the largest is at least 0.6 and the largest in size.
POSITIVE_SHIFT = 1.2
TINY_LENGTH, TINY_SQUARE = 1e-6, 1e-24  # keep quotients and gradients finite at zero


def mlp(in_dim: int, hidden: tuple[int, int, int], out_dim: int) -> nn.Sequential:
    """Return four fully connected layers (Sec. III-G)."""
    dims = (in_dim, *hidden)
    layers: list[nn.Module] = []
    for wide, narrow in pairwise(dims):
        layers += [nn.Linear(wide, narrow), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(hidden[-1], out_dim))


class Heads(nn.Module):
    """Three MLPs: affordance (regression), existence (classification), parameters (regression).

    A plane's normal and an axis have no sign, so a vector that turns with the object must jump
    somewhere. Six regressed numbers instead form a symmetric matrix, which turns without a jump;
    the direction is its leading eigenvector.
    """

    def __init__(self, feature_dim: int) -> None:
        super().__init__()
        num_parameters = 3 * NUM_SLOTS + 6 * NUM_DIRECTIONS
        self.affordance = mlp(feature_dim, HIDDEN, 1)
        self.existence = mlp(feature_dim, HIDDEN, NUM_SLOTS)
        self.symmetry = mlp(feature_dim, PARAMETER_HIDDEN, num_parameters)

    @torch.no_grad()
    def shrink_outputs(self) -> None:
        """Make the first predictions small: planes and axes then start near the centroid."""
        for head in (self.affordance, self.existence, self.symmetry):
            head.get_parameter(f"{len(head) - 1}.weight").mul_(FIRST_OUTPUTS)

    def forward(
        self,
        features: Tensor,  # (B, N, C)
        stride: int = 1,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return affordance (B, N), logits (B, M, 5), center and direction (B, M, 5, 3).

        Every `stride`-th point votes for symmetries, M in all. The sphere has no direction; its
        slot holds zeros.
        """
        voting = features[:, ::stride]
        shape = voting.shape[:2]
        parameters = self.symmetry(voting)
        center = parameters[..., : 3 * NUM_SLOTS].view(*shape, NUM_SLOTS, 3)
        six = parameters[..., 3 * NUM_SLOTS :].view(*shape, NUM_DIRECTIONS, 6)
        direction = functional.pad(leading_direction(six), (0, 0, 0, 1))
        return self.affordance(features)[..., 0], self.existence(voting), center, direction


def leading_direction(
    six: Tensor,  # (..., 6)
) -> Tensor:
    """Return the unit eigenvector (..., 3) of the largest eigenvalue of a symmetric matrix.

    `six` holds xx, yy, zz, xy, xz, yz. A high power of the shifted matrix has columns that are all
    along the eigenvector; the result is the longest. This has a gradient everywhere, also where two
    eigenvalues are equal.
    """
    # Entries are the first axis, so that a product of many 3 x 3 matrices is a few long sums.
    rows = six.movedim(-1, 0).contiguous()
    rows = rows / (_length(rows) + TINY_LENGTH)
    power = (*(rows[:3] + POSITIVE_SHIFT).unbind(), *rows[3:].unbind())
    for _ in range(POWER_STEPS):
        # No overflow: eigenvalues are between -0.1 and 2.5, and 2.5 ** 16 is about 2e6.
        power = _squared(*power)
    xx, yy, zz, xy, xz, yz = power
    column = torch.where(yy > xx, torch.stack([xy, yy, yz]), torch.stack([xx, xy, xz]))
    column = torch.where(zz > torch.maximum(xx, yy), torch.stack([xz, yz, zz]), column)
    return (column / _length(column)).movedim(0, -1)


def _length(
    vectors: Tensor,  # (C, ...)
) -> Tensor:
    """Return lengths (...), with bits that do not depend on a vector's place in its row.

    `Tensor.norm` is slow where C is not the last axis, and `sum` depends on the place.
    """
    squared: Tensor = reduce(torch.add, vectors.square())
    return (squared + TINY_SQUARE).sqrt()


def _squared(
    xx: Tensor, yy: Tensor, zz: Tensor, xy: Tensor, xz: Tensor, yz: Tensor
) -> tuple[Tensor, ...]:
    """Return the six numbers, each (...), of the squares of symmetric matrices."""
    # Not `addcmul`, which rounds the last elements of a row differently from the first.
    xy_xy, xz_xz, yz_yz = xy * xy, xz * xz, yz * yz
    return (
        (xx * xx).add_(xy_xy).add_(xz_xz),
        (yy * yy).add_(xy_xy).add_(yz_yz),
        (zz * zz).add_(xz_xz + yz_yz),
        (xx * xy).add_(xy * yy).add_(xz * yz),
        (xx * xz).add_(xy * yz).add_(xz * zz),
        (xy * xz).add_(yy * yz).add_(yz * zz),
    )
