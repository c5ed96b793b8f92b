"""A workspace about the regions of a frame: a box in the table's frame, or in the camera's."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import transform_points
from pipelines.tabletop.levelling import table_from_camera

BULK = (1.0, 99.0)  # percentiles of a region's points that a box encloses: others are strays
BELOW_TABLE = 0.01  # metres of a box below the table, whose height is not exact
STEP = 0.01  # metres to which corners are rounded, outward
ROUNDING = 1e-6  # of a step; a corner as near to a step stays on it


@dataclass(frozen=True)
class WorkspaceBox:
    """A box for the option `--workspace`.

    Attributes:
        corners: (2, 3) low and high corner, metres, in the box's frame.
        frame: `table` or `camera`.
        T_box_cam: (4, 4), camera to the box's frame.
    """

    corners: Array
    frame: str
    T_box_cam: Array

    @property
    def options(self) -> str:
        """The options of `infer` that set the box."""
        corners = np.round(self.corners, 6).ravel() + 0.0  # no negative zeros
        texts = [np.format_float_positional(value, min_digits=2) for value in corners]
        return f"--workspace={','.join(texts)} --workspace-frame {self.frame}"

    def contains(self, points: Array) -> Mask:
        """Return a mask of `points` (..., 3), camera frame, inside the box; False for nan."""
        placed = transform_points(self.T_box_cam, points.reshape(-1, 3))
        inside = ((placed >= self.corners[0]) & (placed <= self.corners[1])).all(axis=-1)
        return np.asarray(inside.reshape(points.shape[:-1]))


def suggested_box(clouds: Sequence[Array], plane: Plane | None, margin: float) -> WorkspaceBox:
    """Return a box around regions, in the table frame of `plane` if a table is seen.

    `clouds`: points (n, 3) of at least one region, camera frame, metres. `margin`: metres around
    the regions, not below the table.
    """
    T_box_cam = np.eye(4) if plane is None else table_from_camera(plane)
    bounds = [
        np.percentile(transform_points(T_box_cam, points), BULK, axis=0)
        for points in clouds
        if len(points)
    ]
    low, high = (np.array(each) for each in zip(*bounds, strict=True))
    corners = np.stack([low.min(axis=0) - margin, high.max(axis=0) + margin])
    if plane is not None:
        corners[0, 2] = -BELOW_TABLE
    corners[0] = np.floor(corners[0] / STEP + ROUNDING) * STEP
    corners[1] = np.ceil(corners[1] / STEP - ROUNDING) * STEP
    return WorkspaceBox(corners, "camera" if plane is None else "table", T_box_cam)
