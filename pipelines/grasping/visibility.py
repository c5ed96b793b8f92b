"""How much of the room that a hand takes the camera has seen to be free (D. 68)."""

import numpy as np
from numpy.typing import NDArray

from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.observation import SceneCloud

Array = NDArray[np.float64]

TIP_LENGTH = 0.03  # metres of each finger, from its tip, that go where things may be
PLACES = np.array([0.1, 0.5, 0.9])  # along each edge of a finger tip


def seen_share(grasps: Grasps, gripper: Gripper, scene: SceneCloud) -> Array:
    """Return (n,) the share of the open finger tips' room that the camera looks through.

    What lies behind a surface, beside the picture or where nothing was measured is not seen.
    """
    fingers = gripper.boxes(grasps.width)[:, :2]  # (n, 2, 2, 3)
    low, high = fingers[:, :, 0].copy(), fingers[:, :, 1]
    low[..., 0] = np.maximum(low[..., 0], high[..., 0] - TIP_LENGTH)
    lattice = np.stack(np.meshgrid(PLACES, PLACES, PLACES, indexing="ij"), -1).reshape(-1, 3)
    local = low[:, :, None] + lattice * (high - low)[:, :, None]  # (n, 2, 27, 3)
    room = np.einsum("nfpi,nji->nfpj", local, grasps.rotation)
    free = _looked_through((room + grasps.translation[:, None, None]).reshape(-1, 3), scene)
    return np.asarray(free.reshape(len(grasps), local.shape[1] * local.shape[2]).mean(axis=1))


def _looked_through(points: Array, scene: SceneCloud) -> NDArray[np.bool_]:
    """Return which of `points` (n, 3) lie before a measured surface."""
    pixels, free = scene.intrinsics.pixels_of(points)
    free[free] = points[free, 2] < scene.depth[pixels[free, 1], pixels[free, 0]]
    return free
