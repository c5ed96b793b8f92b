"""Principal-directional scale-Invariant Feature Transformer, PIFT (Sec. III-E, Eqs. 3-5).

A small point convolutional network sees a layer's points and predicts T = S R: turn the cloud into
a canonical frame, then scale it along that frame's axes. The layer aggregates features among the
deformed points; its sampled points are mapped back exactly, and so are the planes, axes and centres
that are predicted in the canonical frame.

F^PIFT has two kinds. `ConvolutionPIFT`, as printed, is a point convolution with a regression layer.
The scale of `PIFT` is a learned power of the cloud's own spread: the power -1 undoes a scaling
along the frame's axes (D. 96).
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipelines.network.pointnet2 import SetAbstraction

# All constants here are chosen by eye.
MAX_LOG_SCALE = 1.0  # scales stay within [1/e, e] in every layer
MAX_POINTS = 375  # points seen, or less than twice as many: the pose of a cloud needs no more
TYPICAL_SPREAD = 0.25  # decimetres, root mean square along an axis, of a cloud that is not scaled
MIN_SPREAD = 0.01  # decimetres; flat clouds stay flat
POWER_GAIN = 10.0  # lets one weight learn the power as fast as many learn a regressed number
IDENTITY_6D = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
HIDDEN = 64  # width of the hidden layers
MAX_GROUPS, GROUP_SIZE = 64, 16  # groups of the point convolution


@dataclass(frozen=True)
class Deformation:
    """T = S R about a centre, one for each cloud of a batch.

    Points P_i are in the axes of the network's input: the camera's in the paper, by default the
    table's here (D. 69).
    """

    rotation: Tensor  # (B, 3, 3), R of Eq. 3
    scale: Tensor  # (B, 3), the diagonal of S
    center: Tensor  # (B, 3), centroid of P_i, the fixed point

    def deform(
        self,
        points: Tensor,  # (B, N, 3)
    ) -> Tensor:
        """Return the points in the transformed coordinate frame, S R (p - c) + c (Eq. 3)."""
        center = self.center[:, None]
        turned = (points - center) @ self.rotation.transpose(1, 2)
        return turned * self.scale[:, None] + center  # Eq. 3

    def undo(
        self,
        points: Tensor,  # (B, N, 3)
    ) -> Tensor:
        """Return deformed points in the frame of P_i, R^T S^-1 (p - c) + c (Eq. 5)."""
        center = self.center[:, None]
        return ((points - center) / self.scale[:, None]) @ self.rotation + center  # Eq. 5

    def undo_normals(
        self,
        normals: Tensor,  # (B, N, 3)
    ) -> Tensor:
        """Return unit normals, in the frame of P_i, of planes with `normals` among deformed points.

        A plane n . T(p) = d is (T^T n) . p = d: normals go through R^T S.
        """
        return functional.normalize((normals * self.scale[:, None]) @ self.rotation, dim=-1)

    def undo_directions(
        self,
        directions: Tensor,  # (B, N, 3)
    ) -> Tensor:
        """Return unit directions, in the frame of P_i, of lines among deformed points: R^T S^-1."""
        return functional.normalize((directions / self.scale[:, None]) @ self.rotation, dim=-1)


class PIFT(nn.Module):
    """F^PIFT of Eq. 3: from points and their features to a deformation, the identity at first."""

    def __init__(self, feature_dim: int) -> None:
        super().__init__()
        self.encode = nn.Sequential(
            nn.Linear(3 + feature_dim, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN)
        )
        self.norm = nn.LayerNorm(HIDDEN)
        self.hidden = nn.Linear(HIDDEN, HIDDEN)
        self.regress = _regression()
        self.power = nn.Parameter(torch.zeros(()))  # power of the spread, divided by POWER_GAIN

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        features: Tensor,  # (B, N, C)
    ) -> Deformation:
        """Return the deformation of the whole cloud."""
        center = points.mean(1)
        stride = max(1, points.shape[1] // MAX_POINTS)
        seen, known = points[:, ::stride] - center[:, None], features[:, ::stride]
        encoded = self.encode(torch.cat([seen, known], -1))
        pooled = torch.relu(self.norm(encoded.amax(-2)))
        output = self.regress(torch.relu(self.hidden(pooled)))
        rotation = rotation_from_6d(output[:, :6])
        log_scale = output[:, 6:] + POWER_GAIN * self.power * _log_spread(seen, rotation)
        scale = torch.exp(MAX_LOG_SCALE * torch.tanh(log_scale))
        return Deformation(rotation, scale, center)


class ConvolutionPIFT(nn.Module):
    """F^PIFT as Sec. III-E prints it: a point convolutional network with a regression layer.

    Groups of neighbours are pooled, then all groups; R and S are regressed, the identity at first.
    """

    def __init__(self, feature_dim: int, num_points: int) -> None:
        super().__init__()
        groups = max(1, min(MAX_GROUPS, num_points // 4))
        neighbors = min(GROUP_SIZE, num_points)
        self.convolution = SetAbstraction(feature_dim, (32, 64, HIDDEN), groups, neighbors)
        self.hidden = nn.Linear(HIDDEN, HIDDEN)
        self.regress = _regression()

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        features: Tensor,  # (B, N, C)
    ) -> Deformation:
        """Return the deformation of the whole cloud."""
        _, groups = self.convolution(points, features)
        output = self.regress(torch.relu(self.hidden(groups.amax(-2))))
        scale = torch.exp(MAX_LOG_SCALE * torch.tanh(output[:, 6:]))
        return Deformation(rotation_from_6d(output[:, :6]), scale, points.mean(1))


def _regression() -> nn.Linear:
    """Return a layer that regresses rotation and scale and gives the identity at first."""
    layer = nn.Linear(HIDDEN, 9)
    nn.init.zeros_(layer.weight)
    with torch.no_grad():
        layer.bias.copy_(torch.tensor([*IDENTITY_6D, 0.0, 0.0, 0.0]))
    return layer


def _log_spread(
    points: Tensor,  # (B, N, 3)
    rotation: Tensor,  # (B, 3, 3)
) -> Tensor:
    """Return (B, 3) logarithms of the spread of centred points along the rows of `rotation`.

    Values are relative to a typical spread: 0 leaves the cloud unscaled.
    """
    turned = points @ rotation.transpose(1, 2)
    spread = (turned.square().mean(1) + MIN_SPREAD**2).sqrt()
    return torch.log(spread / TYPICAL_SPREAD)


def rotation_from_6d(
    vectors: Tensor,  # (B, 6)
) -> Tensor:
    """Return rotations (B, 3, 3) with the two orthonormalised 3-vectors as first two rows."""
    first = functional.normalize(vectors[:, :3], dim=-1)
    across = vectors[:, 3:] - (first * vectors[:, 3:]).sum(-1, keepdim=True) * first
    second = functional.normalize(across, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second)], 1)
