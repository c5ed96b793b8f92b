"""Interface of the compared methods that find grasps in a whole frame, without regions."""

from typing import Protocol

import numpy as np

from pipelines.array_types import Array
from pipelines.frames.rgbd import Frame
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.scene import SceneCloud


class FrameMethod(Protocol):
    """A method that finds grasps in a frame without regions."""

    def grasps(
        self, frame: Frame, scene: SceneCloud, rng: np.random.Generator
    ) -> tuple[GraspPoses, Array]:
        """Return grasps, camera frame, and the method's own score (n,) of each.

        Args:
            frame: colour and depth.
            scene: the depth without the holes of sparse sensors, and the support plane.
            rng: for what the method draws.
        """
