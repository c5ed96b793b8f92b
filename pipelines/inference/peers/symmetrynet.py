"""SymmetryNet on the regions of a frame."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from pipelines.geometry.symmetry import SymmetrySlots
from pipelines.grasping.peers.hands import drawn_points
from pipelines.grasping.peers.symmetry_offsets import SymmetryOffsets, symmetries_by_offsets
from pipelines.grasping.scene import RegionCloud, SceneCloud
from pipelines.network.peers.symmetrynet import SymmetryNet
from pipelines.network.peers.symmetrynet_input import normalised_colors, region_crop


@dataclass(frozen=True)
class SymmetryNetMethod:
    """A trained SymmetryNet; `symmetries` is a `RegionMethod`."""

    network: SymmetryNet
    device: torch.device

    def symmetries(
        self, cloud: RegionCloud, scene: SceneCloud, color: NDArray[np.uint8]
    ) -> SymmetrySlots:
        """Return the symmetries of a region, camera frame."""
        return symmetries_by_offsets(self.offsets(cloud, scene, color), scene)

    @torch.inference_mode()
    def offsets(
        self, cloud: RegionCloud, scene: SceneCloud, color: NDArray[np.uint8]
    ) -> SymmetryOffsets:
        """Return the predictions for a sample of a region's points, camera frame."""
        count = self.network.sizes.num_points
        points = drawn_points(cloud.points, count, np.random.default_rng(0))
        pixels, _ = scene.intrinsics.pixels_of(points.astype(np.float64))
        crop = region_crop(color, cloud.mask, pixels)
        inputs = [normalised_colors(torch.from_numpy(crop.image)[None].to(self.device))]
        inputs += [torch.from_numpy(each)[None].to(self.device) for each in (crop.pixels, points)]
        predicted = self.network(*inputs)
        of_points = {
            name: getattr(predicted, name)[0].double().cpu().numpy()
            for name in ("center", "mirrored", "axis_foot", "existence")
        }
        mode = predicted.mode[0].mean(dim=0).double().softmax(dim=0).cpu().numpy()
        return SymmetryOffsets(points.astype(np.float64), mode=mode, **of_points)
