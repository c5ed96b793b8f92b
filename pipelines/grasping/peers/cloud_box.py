"""The points of objects in a frame, and a box around them: GraspNet's input cloud."""

import numpy as np

from pipelines.array_types import Mask
from pipelines.geometry.transforms import transform_points
from pipelines.grasping.peers.darboux import MAX_HEIGHT, MIN_HEIGHT
from pipelines.grasping.scene import SceneCloud
from pipelines.tabletop.levelling import table_from_camera

MARGIN = 0.02  # metres around the objects on the table
OUTLIERS = 0.5  # percent of the points, on each side, that do not widen the box


def object_points(scene: SceneCloud) -> Mask:
    """Return the near pixels (H, W) of the found regions; all near pixels without regions.

    Walls, bins and trays stand over the table too, but belong to no region.
    """
    if scene.objects is None or not (scene.near & scene.objects).any():
        return scene.near
    return np.asarray(scene.near & scene.objects)


def boxed_points(scene: SceneCloud) -> Mask:
    """Return the pixels (H, W) in an upright box around the objects on the table.

    Without a table, all near pixels are returned.
    """
    near = scene.near
    if scene.plane is None or not near.any():
        return near
    local = transform_points(table_from_camera(scene.plane), scene.xyz[near])
    height = local[:, 2]
    standing = object_points(scene)[near] & (height > MIN_HEIGHT) & (height < MAX_HEIGHT)
    if not standing.any():
        return np.zeros_like(near)
    low, high = np.percentile(local[standing], [OUTLIERS, 100.0 - OUTLIERS], axis=0)
    inside = near.copy()
    inside[near] = ((local > low - MARGIN) & (local < high + MARGIN)).all(axis=1)
    return np.asarray(inside)
