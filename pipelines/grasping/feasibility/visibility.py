"""The share of the space around the finger tips that the camera has seen to be free (D. 68)."""

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.camera import Lens
from pipelines.geometry.numerics.compiled import compiled
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.scene import SceneCloud

TIP_LENGTH = 0.03  # metres of each finger, from its tip
PLACES = np.array([0.1, 0.5, 0.9])  # along each edge of a finger tip


def visible_fraction(grasps: GraspPoses, gripper: Gripper, scene: SceneCloud) -> Array:
    """Return the share (n,) of the space of the open finger tips that the camera sees to be free.

    Space behind a surface, outside of the image or without a measurement is unseen.
    """
    fingers = gripper.boxes(grasps.width)[:, :2]  # (n, 2, 2, 3)
    low, high = fingers[:, :, 0].copy(), fingers[:, :, 1]
    low[..., 0] = np.maximum(low[..., 0], high[..., 0] - TIP_LENGTH)
    lattice = np.stack(np.meshgrid(PLACES, PLACES, PLACES, indexing="ij"), -1).reshape(-1, 3)
    local = low[:, :, None] + lattice * (high - low)[:, :, None]  # (n, 2, 27, 3)
    local = local.reshape(len(grasps), local.shape[1] * local.shape[2], 3)
    lens = scene.intrinsics.lens
    return _looked_through(local, grasps.rotation, grasps.translation, scene.depth, lens)


@compiled
def _looked_through(
    local: Array, rotation: Array, translation: Array, depth: Array, lens: Lens
) -> Array:
    """Return the share (n,) of `local` (n, p, 3), in n grasp frames, before a measured surface."""
    fx, fy, cx, cy = lens
    height, width = depth.shape
    share = np.zeros(len(local))
    for n in range(len(local)):
        count = 0
        for p in range(local.shape[1]):
            x, y, z = translation[n, 0], translation[n, 1], translation[n, 2]
            for axis in range(3):
                x += rotation[n, 0, axis] * local[n, p, axis]
                y += rotation[n, 1, axis] * local[n, p, axis]
                z += rotation[n, 2, axis] * local[n, p, axis]
            if z > 0:
                u, v = np.rint(fx * x / z + cx), np.rint(fy * y / z + cy)
                if 0 <= u < width and 0 <= v < height:
                    count += z < depth[int(v), int(u)]
        share[n] = count / local.shape[1]
    return share
