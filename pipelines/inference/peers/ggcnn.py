"""GG-CNN on a frame: depth at 300 pixels, maps, their peaks, grasps along the camera's axis."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch

from pipelines.array_types import Array, Singles
from pipelines.frames.rgbd import Frame
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.peers.grasp_maps import MAP_SIDE, GraspMaps, scaled_rows
from pipelines.grasping.peers.rectangles import RectColumn, rectangle_grasps
from pipelines.grasping.scene import SceneCloud
from pipelines.network.peers.ggcnn import GGCNN, SIDES_BY
from pipelines.network.peers.ggcnn_input import normalised, whole_depth


@dataclass(frozen=True)
class GGCNNMethod:
    """A trained GG-CNN or GG-CNN2; `grasps` is a `FrameMethod`."""

    network: GGCNN
    gripper: Gripper
    device: torch.device

    def grasps(
        self, frame: Frame, scene: SceneCloud, rng: np.random.Generator
    ) -> tuple[GraspPoses, Array]:
        """Return grasps, camera frame, and the predicted quality of each."""
        del frame, rng  # the method needs depth alone, and no random numbers
        depth = whole_depth(scene.depth.astype(np.float32), scene.intrinsics, scene.plane)
        rows = self.maps(depth).rectangles()
        rows = scaled_rows(rows, min(depth.shape) / MAP_SIDE)
        grasps, index = rectangle_grasps(rows, scene.depth, scene.intrinsics, self.gripper)
        return grasps, rows[index, RectColumn.SCORE]

    @torch.inference_mode()
    def maps(self, depth: Singles) -> GraspMaps:
        """Return the maps of `depth` (H, W), metres, resized to 300 pixels on the shorter side."""
        height, width = (
            max(MAP_SIDE, round(side * MAP_SIDE / min(depth.shape))) for side in depth.shape
        )
        small = cv2.resize(depth, (width, height), interpolation=cv2.INTER_AREA)
        step = SIDES_BY[self.network.config.variant]
        beyond = (0, -height % step), (0, -width % step)
        padded = np.pad(normalised(np.asarray(small, np.float32)), beyond, mode="edge")
        found = self.network(torch.from_numpy(padded)[None, None].to(self.device))
        return GraspMaps(*found[0, :, :height, :width].cpu().numpy())
