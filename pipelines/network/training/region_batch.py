"""Batches of labelled regions, for losses and augmentations."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from pipelines.network.sampling import gather


@dataclass(frozen=True)
class RegionBatch:
    """Region clouds and their labels, each centred on its cloud's centroid.

    Axes are the network's `input_frame`. Points are in random order: layers take every n-th.
    """

    points: Tensor  # (B, N, 3) metres
    affordance: Tensor  # (B, N) in [0, 1]
    existence: Tensor  # (B, 5), 0 or 1; slots 0-2 reflection, 3 rotation, 4 sphere
    center: Tensor  # (B, 5, 3) metres; zeros where the slot is empty
    direction: Tensor  # (B, 5, 3) unit; zeros where the slot is empty or has no direction
    ground: Tensor  # (B,) metres from the table up to the centroid; 0 if no table is known
    camera: Tensor  # (B, 3) metres, the place of the camera

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def joined(cls, first: "RegionBatch", second: "RegionBatch") -> "RegionBatch":
        """Return the regions of both, `first` before `second`."""
        names = cls.__dataclass_fields__
        return cls(*(torch.cat([getattr(first, name), getattr(second, name)]) for name in names))

    def __getitem__(self, rows: slice) -> "RegionBatch":
        return self._each(lambda tensor: tensor[rows])

    def to(self, device: torch.device) -> "RegionBatch":
        """Return the batch on `device`."""
        return self._each(lambda tensor: tensor.to(device))

    def at(
        self,
        query: Tensor,  # (B, Q)
    ) -> "RegionBatch":
        """Return the batch with only the points of the indices `query`."""
        return replace(
            self, points=gather(self.points, query), affordance=self.affordance.gather(1, query)
        )

    def mapped(
        self,
        matrix: Tensor,  # (B, 3, 3)
        directions: Tensor | None = None,  # (B, 3, 3)
    ) -> "RegionBatch":
        """Return the batch under linear maps; `directions` maps directions, by default `matrix`."""
        turned = self.direction @ (matrix if directions is None else directions).transpose(1, 2)
        return replace(
            self,
            points=self.points @ matrix.transpose(1, 2),
            center=self.center @ matrix.transpose(1, 2),
            direction=turned,
            ground=self.ground * matrix[:, 2, 2],  # exact unless the map tilts the table
            camera=torch.einsum("bij,bj->bi", matrix, self.camera),
        )

    def _each(self, function: Callable[[Tensor], Tensor]) -> "RegionBatch":
        return RegionBatch(*(function(getattr(self, name)) for name in self.__dataclass_fields__))
