"""The heads: affordance, existence and symmetry parameters of each point (Fig. 5)."""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipelines.geometry.symmetry import NUM_SLOTS
from pipelines.network.leading_direction import leading_direction

NUM_DIRECTIONS = 4  # slots with a direction: all but the sphere
FIRST_OUTPUTS = 0.3  # scale of the last layers' first weights, against Kaiming's


def mlp(in_dim: int, hidden: tuple[int, int, int], out_dim: int) -> nn.Sequential:
    """Return four fully connected layers (Sec. III-G)."""
    dims = (in_dim, *hidden)
    layers: list[nn.Module] = []
    for wide, narrow in pairwise(dims):
        layers += [nn.Linear(wide, narrow), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(hidden[-1], out_dim))


class Heads(nn.Module):
    """Three MLPs: affordance (regression), existence (classification), parameters (regression).

    A plane's normal and an axis have no sign, and a vector that turns with the object must jump
    somewhere. So six numbers are regressed, a symmetric matrix that can turn without a jump, and
    the direction is its leading eigenvector.
    """

    def __init__(self, feature_dim: int) -> None:
        super().__init__()
        self.affordance = mlp(feature_dim, (64, 32, 16), 1)
        self.existence = mlp(feature_dim, (64, 32, 16), NUM_SLOTS)
        self.symmetry = mlp(feature_dim, (128, 96, 64), 3 * NUM_SLOTS + 6 * NUM_DIRECTIONS)

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
