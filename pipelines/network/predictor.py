"""The trained grasp network as a function from region clouds to predictions of their points."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.array_types import Array, Floats, Singles
from pipelines.configs import NetworkConfig
from pipelines.errors import ValueRangeError
from pipelines.geometry.pointcloud import Plane, drawn_indices
from pipelines.network.cpu.cloudwise import threads_of_one_core
from pipelines.network.cpu.folding import folded
from pipelines.network.devices import find_device
from pipelines.network.mirror_copies import MIRROR, RegionOutputs, with_copy
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.weights_files import fill, read_weights
from pipelines.tabletop.levelling import level_axes

# Every third point votes for symmetries; points are in random order, and their mean counts.
VOTING_STRIDE = 3


@dataclass(frozen=True)
class RegionPrediction(RegionOutputs):
    """The outputs for one region, camera frame: for N points, with M votes for symmetries.

    Every third point votes, twice if there is a mirrored copy.
    """

    # (N,) indices of the drawn points of the region; some twice if the region has fewer.
    index: NDArray[np.int64]


class GraspPredictor:
    """Draws points from regions, centres them, runs the network on all regions at once.

    `mirrored`: whether the network also sees the regions' mirror images (D. 101).
    """

    def __init__(
        self,
        network: SymmetryGraspNet,
        config: NetworkConfig,
        device: torch.device,
        mirrored: bool = False,
    ) -> None:
        self.network, self.config, self.device = folded(network.to(device)), config, device
        self.mirrored = mirrored

    @classmethod
    def load(cls, path: Path, device: str = "auto", mirrored: bool = False) -> Self:
        """Read weights that `symgrasp train` wrote; `mirrored` as in the class.

        Raises:
            FormatError: the file holds no weights of this network.
        """
        found = find_device(device)
        tensors, config = read_weights(path, SymmetryGraspNet.__name__, NetworkConfig)
        network = SymmetryGraspNet(config)
        fill(network, tensors, path)
        return cls(network, config, found, mirrored)

    def predict(
        self, clouds: Sequence[Floats], table: Plane | None = None
    ) -> list[RegionPrediction]:
        """Return predictions for regions of (n, 3) points each, metres, camera frame.

        `table`: the support plane, camera frame, normal up; None if unknown.

        A region's prediction depends on the region alone, on a CPU to the last bit, and not on
        other regions of the list or on the number of threads (D. 61).

        Raises:
            ValueRangeError: a region has no points, or points that are not finite.
        """
        if not clouds:
            return []
        index = np.stack([self._draw(cloud) for cloud in clouds])
        pairs = zip(clouds, index, strict=True)
        drawn = np.stack([np.asarray(cloud, np.float64)[chosen] for cloud, chosen in pairs])
        centroid = drawn.mean(1, keepdims=True)
        axes = self._axes(centroid[:, 0], table)
        height = np.zeros(len(drawn)) if table is None else table.height(centroid[:, 0])
        ground = height.astype(np.float32)
        turned = axes.transpose(0, 2, 1)
        centered = ((drawn - centroid) @ turned).astype(np.float32)
        camera = (-centroid @ turned)[:, 0].astype(np.float32)
        outputs = self._outputs(centered, ground, camera)
        if self.mirrored:
            copies = centered @ MIRROR, ground, camera @ MIRROR
            outputs = with_copy(outputs, self._outputs(*copies).mirrored())
        back = axes[:, None].astype(np.float32)
        centers = outputs.center @ back + centroid[:, :, None].astype(np.float32)
        direction = outputs.direction @ back
        columns = (outputs.affordance, outputs.existence, centers, direction, index)
        return [RegionPrediction(*each) for each in zip(*columns, strict=True)]

    def _axes(self, centroids: Array, table: Plane | None) -> Array:
        """Return (B, 3, 3) rotations from camera axes to the axes of the input frame."""
        if self.config.input_frame == "camera":
            return np.broadcast_to(np.eye(3), (len(centroids), 3, 3))
        return np.stack([level_axes(center, table) for center in centroids])

    def _outputs(self, points: Singles, ground: Singles, camera: Singles) -> RegionOutputs:
        """Return the output for (B, N, 3) centred points, `ground` (B,) metres over the table.

        `camera` (B, 3): camera's place in the frame of the points. On a CPU each thread takes some
        of the clouds: most operations are too small for several threads, which would also round
        differently.
        """
        seen = [torch.from_numpy(each).to(self.device) for each in (points, ground, camera)]
        threads = torch.get_num_threads()
        if self.device.type != "cpu" or threads == 1:
            return RegionOutputs(*self._run_together(*seen))
        shares = (each.tensor_split(min(threads, len(points))) for each in seen)
        parts = list(threads_of_one_core().map(self._run_together, *shares))
        return RegionOutputs(*map(np.concatenate, zip(*parts, strict=True)))

    @torch.inference_mode()
    def _run_together(self, points: Tensor, ground: Tensor, camera: Tensor) -> tuple[Singles, ...]:
        prediction = self.network(points, ground, stride=VOTING_STRIDE, camera=camera)
        columns = (
            prediction.affordance.clamp(0.0, 1.0),
            # Cloud by cloud: the last numbers of a long row are rounded differently from the first.
            torch.stack([torch.sigmoid(logits) for logits in prediction.existence]),
            prediction.center,
            prediction.direction,
        )
        return tuple(column.cpu().numpy() for column in columns)

    def _draw(self, cloud: Floats) -> NDArray[np.int64]:
        """Return the indices (N,) of the points of `cloud` that the network sees, in random order.

        `SetAbstraction` and the votes assume that order.
        """
        points = np.asarray(cloud)
        if points.ndim != 2 or points.shape[1] != 3 or not len(points):
            raise ValueRangeError(
                "shape of a region's points", points.shape, "(n, 3), n at least 1"
            )
        if not np.isfinite(points).all():
            raise ValueRangeError("a region's points", "not finite", "finite, metres")
        return drawn_indices(len(points), self.config.num_points, np.random.default_rng(0))
