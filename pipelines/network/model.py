"""The symmetry-aware grasp detection network: PointNet++ with PIFT, and its heads (Sec. III-E)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipelines.configs import NetworkConfig
from pipelines.geometry.symmetry import ROTATION_SLOT
from pipelines.network.heads import Heads
from pipelines.network.pift import PIFT, ConvolutionPIFT, Deformation
from pipelines.network.pointnet2 import FeaturePropagation, SetAbstraction
from pipelines.network.sampling import gather

# Inside the network lengths are decimetres: a household object is then about one unit long.
UNITS_PER_METER = 10.0

# Per level: widths of the set abstraction's three layers; the last one is also the width of the
# propagation back to the second and the third level.
SET_DIMS = ((32, 64, 64), (64, 128, 128), (128, 192, 192), (192, 256, 256))


@dataclass(frozen=True)
class Prediction:
    """Output of the network for each of N points, M of which vote for symmetries."""

    features: Tensor  # (B, N, 128), f_j
    affordance: Tensor  # (B, N), a_j, trained towards [0, 1] but not confined to it
    existence: Tensor  # (B, M, 5) logits of c_jk; slots 0-2 reflection, 3 rotation, 4 sphere
    center: Tensor  # (B, M, 5, 3) metres, in the frame of the input points
    direction: Tensor  # (B, M, 5, 3) unit normals and axes; zeros for the sphere


@dataclass(frozen=True)
class PointFeatures:
    """Features of Q points of each of B clouds."""

    values: Tensor  # (B, Q, 128), f_j
    # Deformation of the first level, in the frame of which symmetries are predicted; None if
    # this is the frame of the input.
    deformation: Deformation | None


class SymmetryGraspNet(nn.Module):
    """Four set abstractions, each behind a PIFT, four feature propagations, and heads."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.sees_height = config.input_frame == "table"
        self.sees_camera = config.sees_camera
        self.is_canonical = config.use_pift and config.canonical_frame
        seen = 3 + self.sees_height + 3 * self.sees_camera
        dims = [seen, *(widths[-1] for widths in SET_DIMS)]
        sizes = zip(config.set_points, config.set_neighbors, config.set_strides, strict=True)
        self.set_abstractions = nn.ModuleList(
            SetAbstraction(dims[i], SET_DIMS[i], *size) for i, size in enumerate(sizes)
        )
        self.pifts = nn.ModuleList(_pifts(dims[:-1], config)) if config.use_pift else None
        out_dims = [config.feature_dim, config.feature_dim, *dims[2:4]]
        self.propagations = nn.ModuleList(
            FeaturePropagation((*out_dims, dims[4])[i + 1], dims[i], out_dims[i]) for i in range(4)
        )
        self.heads = Heads(config.feature_dim)
        self._initialize()

    def _initialize(self) -> None:
        """Draw weights so that differences between points reach the heads undiminished.

        torch's default shrinks the differences at each layer, and its biases add a common part.
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
        camera: Tensor | None = None,  # (B, 3)
    ) -> PointFeatures:
        """Return the features of the points with indices `query`, by default of all points.

        Args:
            points: metres, axes of the `input_frame`, centred on their centroid, in random order,
                which the strides of `SetAbstraction`, `PIFT` and `predict` assume.
            ground: metres from the table up to the centroid, 0 (the default) where it is not
                known; for networks with the input frame `table`.
            query: indices of points.
            camera: metres, camera's place in the frame of the points; for networks that see it.
        """
        points = points * UNITS_PER_METER
        first = points  # P_0; its own coordinates, and heights, are its first features
        if self.sees_height:
            ground = points.new_zeros(len(points)) if ground is None else ground
            first = torch.cat([points, _heights(points, ground * UNITS_PER_METER)], -1)
        if self.sees_camera:
            place = torch.zeros_like(points[:, 0]) if camera is None else camera * UNITS_PER_METER
            first = torch.cat([first, functional.normalize(place[:, None] - points, dim=-1)], -1)
        canonical = self._deformation(0, points, first)
        if canonical is not None and self.is_canonical:
            # Predictions in that frame are made from coordinates in it (D. 95).
            first = torch.cat([canonical.deform(points), first[..., 3:]], -1)
        levels = [(points, first), self._abstract(0, points, first, canonical)]
        for i in range(1, 4):
            levels.append(self._abstract(i, *levels[-1], self._deformation(i, *levels[-1])))
        if query is not None:
            levels[0] = (gather(points, query), gather(first, query))
        coarse_points, coarse = levels[4]
        for i in (3, 2, 1, 0):
            coarse = self.propagations[i](*levels[i], coarse_points, coarse)
            coarse_points = levels[i][0]
        return PointFeatures(coarse, canonical if self.is_canonical else None)

    def _deformation(self, level: int, points: Tensor, features: Tensor) -> Deformation | None:
        """Return T_i (Eq. 3); None without PIFT."""
        if self.pifts is None:
            return None
        found: Deformation = self.pifts[level](points, features)
        return found

    def _abstract(
        self, level: int, points: Tensor, features: Tensor, deformation: Deformation | None
    ) -> tuple[Tensor, Tensor]:
        """Return P_{i+1}, axes of P_0, and E_{i+1} (Eqs. 3 to 5)."""
        abstraction = self.set_abstractions[level]
        if deformation is None:
            sampled, aggregated = abstraction(points, features)
            return sampled, aggregated
        deformed, aggregated = abstraction(deformation.deform(points), features)
        return deformation.undo(deformed), aggregated

    def predict(self, features: PointFeatures, stride: int = 1) -> Prediction:
        """Return the output of the heads; every `stride`-th point votes for symmetries."""
        values = features.values
        affordance, existence, center, direction = self.heads(values, stride)
        if features.deformation is not None:
            center, direction = _undone(features.deformation, center, direction)
        return Prediction(values, affordance, existence, center / UNITS_PER_METER, direction)

    def forward(
        self,
        points: Tensor,  # (B, N, 3)
        ground: Tensor | None = None,  # (B,)
        query: Tensor | None = None,  # (B, Q)
        stride: int = 1,
        camera: Tensor | None = None,  # (B, 3)
    ) -> Prediction:
        """Return predictions at the points `query`, by default at all; units as `features`.

        Every `stride`-th of these points votes for symmetries.
        """
        return self.predict(self.features(points, ground, query, camera), stride)


def _pifts(dims: Sequence[int], config: NetworkConfig) -> Iterator[nn.Module]:
    """Yield F^PIFT of each level; `dims`: number of features of a point at each level."""
    for dim, count in zip(dims, (config.num_points, *config.set_points[:-1]), strict=True):
        yield PIFT(dim) if config.pift == "spread" else ConvolutionPIFT(dim, count)


def _undone(
    deformation: Deformation,
    center: Tensor,  # (B, N, 5, 3)
    direction: Tensor,  # (B, N, 5, 3)
) -> tuple[Tensor, Tensor]:
    """Return centres and directions of the deformed frame in the frame of P_0.

    Features that are invariant to a scaling cannot place the centre of a scaled cloud; in the
    deformed frame, where the scaling is undone, the centre does not move (D. 83).
    """
    batch = len(center)
    planes, axis, none = torch.split(direction, [ROTATION_SLOT, 1, 1], dim=2)
    planes = deformation.undo_normals(planes.reshape(batch, -1, 3)).view(planes.shape)
    axis = deformation.undo_directions(axis[:, :, 0])[:, :, None]
    center = deformation.undo(center.reshape(batch, -1, 3)).view(center.shape)
    return center, torch.cat([planes, axis, none], 2)


def _heights(
    points: Tensor,  # (B, N, 3)
    ground: Tensor,  # (B,)
) -> Tensor:
    """Return (B, N, 1) heights above the table; zeros if no table is known."""
    known = (ground != 0)[:, None, None]
    return torch.where(known, points[..., 2:] + ground[:, None, None], 0.0)
