"""The limits of a robot: a workspace for grasps, and a cone of approaches."""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.configs import LimitsConfig, check_settings
from pipelines.errors import ValueRangeError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.geometry.transforms import rotate_vectors, transform_points, unit
from pipelines.grasping.grasps import GraspPoses
from pipelines.tabletop.levelling import table_from_camera

ANY_DIRECTION = 180.0  # degrees
FARTHEST = 50.0  # metres, largest coordinate of a corner; larger numbers are millimetres
ROUNDING = 1e-9  # of a cosine


@dataclass(frozen=True)
class Limits:
    """The limits of one frame's grasps.

    Attributes:
        box: (2, 3) low and high corner in metres, in the target frame of `T_box_cam`.
        T_box_cam: (4, 4).
        direction: (3,) unit, camera frame: the cone's axis.
        cone: radians from the axis; pi allows every approach.
        mask: (H, W) pixels within the workspace; None for all.
        intrinsics: intrinsics of the mask.
    """

    box: Array
    T_box_cam: Array
    direction: Array
    cone: float
    mask: Mask | None
    intrinsics: Intrinsics

    @classmethod
    def of(
        cls, config: LimitsConfig, mask: Mask | None, plane: Plane | None, intrinsics: Intrinsics
    ) -> "Limits | None":
        """Return the limits of a frame with support `plane`; None without limits.

        Raises:
            ValueRangeError: limits in the table frame, but no table is seen.
        """
        has_cone = config.approach_cone < ANY_DIRECTION
        if not (config.box or has_cone or mask is not None):
            return None
        everywhere = np.array([[-np.inf] * 3, [np.inf] * 3])
        T_box_cam = _frame(config.box_frame if config.box else "camera", plane)
        T_cone_cam = _frame(config.approach_frame if has_cone else "camera", plane)
        direction = unit(np.asarray(config.approach_direction, np.float64))
        return cls(
            np.reshape(config.box, (2, 3)).astype(np.float64) if config.box else everywhere,
            T_box_cam,
            rotate_vectors(T_cone_cam.T, direction),
            float(np.radians(config.approach_cone)),
            mask,
            intrinsics,
        )

    def contain(self, points: Array) -> Mask:
        """Return a mask (n,) of `points` (n, 3), camera frame, inside the workspace."""
        placed = transform_points(self.T_box_cam, points)
        inside = ((placed >= self.box[0]) & (placed <= self.box[1])).all(axis=-1)
        if self.mask is None or not inside.any():
            return np.asarray(inside)
        pixels, shown = self.intrinsics.pixels_of(points)
        inside &= shown
        inside[inside] = self.mask[pixels[inside, 1], pixels[inside, 0]]
        return np.asarray(inside)

    def allow(self, grasps: GraspPoses) -> Mask:
        """Return a mask (n,) of grasps with origin in the workspace and approach in the cone."""
        along = grasps.approach @ self.direction
        allowed = along >= np.cos(self.cone) - ROUNDING
        allowed[allowed] = self.contain(grasps.translation[allowed])
        return np.asarray(allowed)


def check_limits(config: LimitsConfig) -> None:
    """Raise ValueRangeError or UnknownNameError if `config` holds impossible limits."""
    check_settings(config)
    given, box = list(config.box), np.asarray(config.box, np.float64)
    if len(box) and not (len(box) == 6 and np.isfinite(box).all() and (box[:3] < box[3:]).all()):
        expected = "x0,y0,z0,x1,y1,z1 in metres, each first below its last (setting limits.box)"
        raise ValueRangeError("--workspace", given, expected)
    if len(box) and np.abs(box).max() > FARTHEST:
        expected = f"within {FARTHEST:g} m; divide millimetres by 1000 (setting limits.box)"
        raise ValueRangeError("--workspace", given, expected)
    direction = np.asarray(config.approach_direction, np.float64)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        given = list(config.approach_direction)
        expected = "x,y,z, not all zero (setting limits.approach_direction)"
        raise ValueRangeError("--approach-direction", given, expected)
    if not 0.0 < config.approach_cone <= ANY_DIRECTION:
        expected = "degrees from its axis, above 0, at most 180 (setting limits.approach_cone)"
        raise ValueRangeError("--approach-cone", config.approach_cone, expected)


def _frame(name: str, plane: Plane | None) -> Array:
    """Return the transform (4, 4) from the camera frame to the frame `name`."""
    if name == "camera":
        return np.eye(4)
    if plane is None:
        expected = "in view, or the limits given in the camera's frame"
        raise ValueRangeError("table of this frame", "not found", expected)
    return table_from_camera(plane)
