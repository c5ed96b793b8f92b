"""Multi-Grasp on a frame: an RGD image, rectangles, grasps along the camera's axis."""

from dataclasses import dataclass

import numpy as np
import torch
from torchvision.models.detection import FasterRCNN

from pipelines.array_types import Array
from pipelines.configs.peers import PeerNetworkConfig
from pipelines.frames.rgbd import Frame
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.peers.grasp_maps import scaled_rows
from pipelines.grasping.peers.oriented_boxes import rows_of_boxes
from pipelines.grasping.peers.rectangles import RectColumn, rectangle_grasps
from pipelines.grasping.scene import SceneCloud
from pipelines.network.peers.multi_grasp import LONG_SIDES, SHORT_SIDES
from pipelines.network.peers.rgd import rgd_pixels, rgd_tensor
from pipelines.tabletop.depth_channels import shrink


@dataclass(frozen=True)
class MultiGraspMethod:
    """A trained Multi-Grasp of the size in `config`; `grasps` is a `FrameMethod`."""

    network: FasterRCNN
    gripper: Gripper
    device: torch.device
    config: PeerNetworkConfig

    @torch.inference_mode()
    def grasps(
        self, frame: Frame, scene: SceneCloud, rng: np.random.Generator
    ) -> tuple[GraspPoses, Array]:
        """Return grasps, camera frame, and the probability of each."""
        del rng  # the method needs no random numbers
        variant, depth = self.config.variant, scene.depth.astype(np.float32)
        sides = SHORT_SIDES[variant], LONG_SIDES[variant]
        small = shrink(frame.color, depth, scene.intrinsics, *sides)
        image = rgd_tensor(rgd_pixels(small.color, small.depth)).to(self.device)
        (found,) = self.network([image])
        boxes, labels, score = (found[name].cpu().numpy() for name in ("boxes", "labels", "scores"))
        rows = rows_of_boxes(boxes.astype(np.float64), labels, score.astype(np.float64))
        rows = scaled_rows(rows, scene.intrinsics.width / small.intrinsics.width)
        grasps, index = rectangle_grasps(rows, scene.depth, scene.intrinsics, self.gripper)
        return grasps, rows[index, RectColumn.SCORE]
