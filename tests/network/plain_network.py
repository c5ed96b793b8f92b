"""The network in the paper's form: each group formed first, each layer separate, no shortcuts.

PointNet++ with PIFT from the weights of a `SymmetryGraspNet`, one cloud at a time, in the precision
of its points. It is slow; tests and benchmarks compare the fast network with it.
"""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from pipelines.configs import NetworkConfig
from pipelines.network.heads import POSITIVE_SHIFT
from pipelines.network.model import UNITS_PER_METER, Prediction
from pipelines.network.pift import (
    MAX_LOG_SCALE,
    MAX_POINTS,
    MIN_SPREAD,
    POWER_GAIN,
    TYPICAL_SPREAD,
)


@dataclass(frozen=True)
class PlainNetwork:
    """The plain network; with `use_pift` False it is PointNet++ alone, for any weights."""

    state: dict[str, Tensor]
    config: NetworkConfig
    use_pift: bool = True

    def __call__(self, clouds: Tensor) -> Prediction:
        """Return predictions (B, N, ...) at points (B, N, 3), metres.

        Table and camera are unknown: the height is 0, the camera at the origin.
        """
        features = torch.stack([self._features(cloud * UNITS_PER_METER) for cloud in clouds])
        affordance, existence, center, direction = self._heads(features)
        if self.use_pift and self.config.canonical_frame:
            for b, cloud in enumerate(clouds):
                T, about = self._pift(
                    0, cloud * UNITS_PER_METER, self._first(cloud * UNITS_PER_METER)
                )
                about = about / UNITS_PER_METER
                center[b] = (center[b] - about) @ torch.linalg.inv(T).T + about
                direction[b, :, :3] = functional.normalize(direction[b, :, :3] @ T, dim=-1)
                axis = direction[b, :, 3] @ torch.linalg.inv(T).T
                direction[b, :, 3] = functional.normalize(axis, dim=-1)
        return Prediction(features, affordance, existence, center, direction)

    def _first(self, points: Tensor) -> Tensor:
        inputs = [points]
        if self.config.input_frame == "table":
            inputs.append(points.new_zeros(len(points), 1))  # heights
        if self.config.sees_camera:
            inputs.append(functional.normalize(-points, dim=-1))
        return torch.cat(inputs, 1)

    def _features(self, points: Tensor) -> Tensor:
        first = self._first(points)
        levels = [(points, first), self._abstract(0, points, first)]
        for level in range(1, 4):
            levels.append(self._abstract(level, *levels[-1]))
        levels[0] = points, self._content(0, points, first)
        coarse_points, coarse = levels[4]
        for level in (3, 2, 1, 0):
            fine_points, fine = levels[level]
            coarse = self._propagate(level, fine_points, fine, coarse_points, coarse)
            coarse_points = fine_points
        return coarse

    def _abstract(self, level: int, points: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        if not self.use_pift:
            return self._set_abstraction(level, points, features)
        T, center = self._pift(level, points, features)  # Eq. 3
        content = self._content(level, points, features)
        sampled, pooled = self._set_abstraction(level, (points - center) @ T.T + center, content)
        return (sampled - center) @ torch.linalg.inv(T).T + center, pooled  # Eqs. 4, 5

    def _content(self, level: int, points: Tensor, features: Tensor) -> Tensor:
        """Return the aggregated features: at the first level the deformed coordinates."""
        if level or not (self.use_pift and self.config.canonical_frame):
            return features
        T, center = self._pift(0, points, features)
        return torch.cat([(points - center) @ T.T + center, features[:, 3:]], 1)

    def _pift(self, level: int, points: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        name, center = f"pifts.{level}", points.mean(0)
        stride = max(1, len(points) // MAX_POINTS)
        seen = torch.cat([points - center, features], 1)[::stride]
        hidden = torch.relu(self._linear(f"{name}.encode.0", seen))
        pooled = self._linear(f"{name}.encode.2", hidden).amax(0)
        pooled = functional.layer_norm(
            pooled, pooled.shape, self._of(f"{name}.norm.weight"), self._of(f"{name}.norm.bias")
        )
        out = self._linear(
            f"{name}.regress", torch.relu(self._linear(f"{name}.hidden", torch.relu(pooled)))
        )
        # Gram-Schmidt, written as the QR decomposition with a positive diagonal.
        q, r = torch.linalg.qr(out[:6].view(2, 3).T)
        first, second = (q * r.diagonal().sign()).T
        R = torch.stack([first, second, torch.linalg.cross(first, second)])
        turned = (points - center)[::stride] @ R.T
        spread = torch.sqrt(turned.square().mean(0) + MIN_SPREAD**2) / TYPICAL_SPREAD
        log_scale = out[6:] + POWER_GAIN * self._of(f"{name}.power") * spread.log()
        return torch.diag(torch.exp(MAX_LOG_SCALE * torch.tanh(log_scale))) @ R, center

    def _set_abstraction(
        self, level: int, points: Tensor, features: Tensor
    ) -> tuple[Tensor, Tensor]:
        name, config = f"set_abstractions.{level}", self.config
        centers = points[farthest(points, config.set_points[level])]
        stride = config.set_strides[level]
        points, features = points[::stride], features[::stride]
        near = nearest(centers, points, config.set_neighbors[level])
        grouped = torch.cat([points[near] - centers[:, None], features[near]], -1)
        first = torch.cat(
            [self._of(f"{name}.position.weight"), self._of(f"{name}.content.weight")], 1
        )
        hidden = torch.relu(grouped @ first.T + self._of(f"{name}.content.bias"))
        pooled = (hidden @ self._of(f"{name}.group.weight").T).amax(1)
        pooled = torch.relu(self._norm(f"{name}.point.0", pooled))
        return centers, torch.relu(
            self._norm(f"{name}.point.3", self._linear(f"{name}.point.2", pooled))
        )

    def _propagate(
        self, level: int, points: Tensor, features: Tensor, coarse_points: Tensor, coarse: Tensor
    ) -> Tensor:
        name = f"propagations.{level}"
        near = nearest(points, coarse_points, 3)
        weight = 1.0 / ((points[:, None] - coarse_points[near]).square().sum(-1) + 1e-8)
        weight = weight / weight.sum(1, keepdim=True)
        joined = torch.cat([(coarse[near] * weight[..., None]).sum(1), features], 1)
        first = torch.cat([self._of(f"{name}.coarse.weight"), self._of(f"{name}.fine.weight")], 1)
        hidden = joined @ first.T + self._of(f"{name}.fine.bias")
        hidden = torch.relu(self._norm(f"{name}.joined.0", hidden))
        return torch.relu(self._norm(f"{name}.joined.3", self._linear(f"{name}.joined.2", hidden)))

    def _heads(self, features: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        numbers = {}
        for head in ("affordance", "existence", "symmetry"):
            x = features
            for layer in (0, 2, 4):
                x = torch.relu(self._linear(f"heads.{head}.{layer}", x))
            numbers[head] = self._linear(f"heads.{head}.6", x)
        symmetry = numbers["symmetry"]
        center = symmetry[..., :15].unflatten(-1, (5, 3)) / UNITS_PER_METER
        six = symmetry[..., 15:].unflatten(-1, (4, 6))
        six = six / (six.norm(dim=-1, keepdim=True) + 1e-6)
        matrix = six[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].unflatten(-1, (3, 3))
        power = torch.linalg.matrix_power(matrix + POSITIVE_SHIFT * torch.eye(3).to(six), 16)
        column = power.diagonal(dim1=-2, dim2=-1).argmax(-1)[..., None, None]
        direction = power.gather(-1, column.expand(*column.shape[:-2], 3, 1))[..., 0]
        direction = functional.pad(functional.normalize(direction, dim=-1), (0, 0, 0, 1))
        return numbers["affordance"][..., 0], numbers["existence"], center, direction

    def _of(self, name: str) -> Tensor:
        return self.state[name]

    def _linear(self, name: str, values: Tensor) -> Tensor:
        return values @ self._of(f"{name}.weight").T + self._of(f"{name}.bias")

    def _norm(self, name: str, values: Tensor) -> Tensor:
        variance = self._of(f"{name}.running_var") + 1e-5
        normalised = (values - self._of(f"{name}.running_mean")) / variance.sqrt()
        return normalised * self._of(f"{name}.weight") + self._of(f"{name}.bias")


def farthest(points: Tensor, count: int) -> list[int]:
    """Return the first of a cloud's points (N, 3) and those farthest from it, greedily."""
    points = points.float()
    chosen, distance = [0], torch.full((len(points),), torch.inf)
    while len(chosen) < min(count, len(points)):
        distance = torch.minimum(distance, (points - points[chosen[-1]]).square().sum(-1))
        chosen.append(int(distance.argmax()))
    return chosen


def nearest(queries: Tensor, support: Tensor, count: int) -> Tensor:
    """Return indices (M, count) of the nearest support points, by sorting all of them."""
    offset = queries.float()[:, None] - support.float()[None]
    return offset.square().sum(-1).argsort(-1)[:, :count]
