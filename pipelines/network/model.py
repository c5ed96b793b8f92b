"""The symmetry-aware grasp detection network: PointNet++ with PIFT, and its heads (Sec. III-E)."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pipelines.configs import NetworkConfig
from pipelines.network.heads import Heads
from pipelines.network.pift import PIFT
from pipelines.network.pointnet2 import FeaturePropagation, SetAbstraction
from pipelines.network.sampling import gather

# Inside the network lengths are decimetres: a household object is then about one unit long.
UNITS_PER_METER = 10.0

# Per level: widths of the set abstraction's three layers, and of the propagation back to it.
SET_DIMS = ((32, 64, 64), (64, 128, 128), (128, 192, 192), (192, 256, 256))


@dataclass(frozen=True)
class Prediction:
    """What the network says of each point; N is the number of points asked about.

    Attributes:
        features: (B, N, 128), f_j.
        affordance: (B, N), a_j, trained towards [0, 1] but not confined to it.
        existence: (B, N, 5) logits of c_jk; slots 0-2 reflection, 3 rotation, 4 sphere.
        center: (B, N, 5, 3) metres, in the frame of the input points.
        direction: (B, N, 5, 3) unit normals and axes; zeros for the sphere.
    """

    features: Tensor
    affordance: Tensor
    existence: Tensor
    center: Tensor
    direction: Tensor


class SymmetryGraspNet(nn.Module):
    """Four set abstractions, each behind a PIFT, four feature propagations, and heads."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.sees_height = config.input_frame == "table"
        dims = [4 if self.sees_height else 3, *(widths[-1] for widths in SET_DIMS)]
        sizes = zip(config.set_points, config.set_neighbors, config.set_strides, strict=True)
        self.set_abstractions = nn.ModuleList(
            SetAbstraction(dims[i], SET_DIMS[i], *size) for i, size in enumerate(sizes)
        )
        self.pifts = nn.ModuleList(PIFT(dim) for dim in dims[:-1]) if config.use_pift else None
        out_dims = [config.feature_dim, config.feature_dim, *dims[2:4]]
        self.propagations = nn.ModuleList(
            FeaturePropagation((*out_dims, dims[4])[i + 1], dims[i], out_dims[i]) for i in range(4)
        )
        self.heads = Heads(config.feature_dim)
        self._initialize()

    def _initialize(self) -> None:
        """Draw weights so that what differs between points reaches the heads undiminished.

        torch's default shrinks it at each layer while biases add what is common to all points.
        """
        for name, module in self.named_modules():
            if isinstance(module, nn.Linear) and not name.endswith("regress"):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        self.heads.shrink_outputs()

    def features(
        self,
        points: Tensor,  # (B, N, 3)
        ground: Tensor | None = None,  # (B,)
        query: Tensor | None = None,  # (B, Q)
    ) -> Tensor:
        """Return features (B, Q, 128) of the points with indices `query`, by default of all.

        Args:
            points: metres, axes of the `input_frame`, centred on their centroid.
            ground: metres from the table up to the centroid, 0 (as by default) where it is not
                known; of use to networks with the input frame `table`.
            query: which points to answer for.
        """
        points = points * UNITS_PER_METER
        first = points  # P_0; its own coordinates, and heights, are its first features
        if self.sees_height:
            ground = points.new_zeros(len(points)) if ground is None else ground
            first = torch.cat([points, _heights(points, ground * UNITS_PER_METER)], -1)
        levels = [(points, first)]
        for i in range(4):
            levels.append(self._abstract(i, *levels[-1]))
        if query is not None:
            levels[0] = (gather(points, query), gather(first, query))
        coarse_points, coarse = levels[4]
        for i in (3, 2, 1, 0):
            coarse = self.propagations[i](*levels[i], coarse_points, coarse)
            coarse_points = levels[i][0]
        return coarse

    def _abstract(self, level: int, points: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return P_{i+1}, axes of P_0, and E_{i+1}."""
        if self.pifts is None:
            sampled: tuple[Tensor, Tensor] = self.set_abstractions[level](points, features)
            return sampled
        deformation = self.pifts[level](points, features)
        deformed, aggregated = self.set_abstractions[level](deformation.deform(points), features)
        return deformation.undo(deformed), aggregated

    def predict(
        self,
        features: Tensor,  # (B, N, 128)
    ) -> Prediction:
        """Return what the heads make of point features."""
        affordance, existence, center, direction = self.heads(features)
        return Prediction(features, affordance, existence, center / UNITS_PER_METER, direction)

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        ground: Tensor | None = None,  # (B,)
        query: Tensor | None = None,  # (B, Q)
    ) -> Prediction:
        """Return predictions at the points `query`, by default at all; units as `features`."""
        return self.predict(self.features(points, ground, query))


def _heights(
    points: Tensor,  # (B, N, 3)
    ground: Tensor,  # (B,)
) -> Tensor:
    """Return (B, N, 1) heights above the table; zeros where it is not known."""
    known = (ground != 0)[:, None, None]
    return torch.where(known, points[..., 2:] + ground[:, None, None], 0.0)
