"""The pinhole camera: intrinsics, projection, backprojection. OpenCV axes, no distortion."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.errors import ValueRangeError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Intrinsics:
    """Focal lengths and principal point in pixels; the centre of the first pixel is (0, 0)."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        if not (
            np.isfinite([self.fx, self.fy, self.cx, self.cy]).all() and min(self.fx, self.fy) > 0
        ):
            raise ValueRangeError(
                "intrinsics",
                (self.fx, self.fy, self.cx, self.cy),
                "finite fx, fy > 0, cx, cy in pixels",
            )
        if self.width < 1 or self.height < 1:
            raise ValueRangeError("image size", (self.width, self.height), "positive")

    @classmethod
    def from_matrix(cls, K: ArrayLike, width: int, height: int) -> "Intrinsics":
        """Return the intrinsics of the (3, 3) camera matrix `K`."""
        K = np.asarray(K, np.float64)
        return cls(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), width, height)

    @property
    def matrix(self) -> Array:
        """The (3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def project(self, points: ArrayLike) -> Array:
        """Return the pixels (..., 2) as (u, v) of `points` (..., 3), camera frame, z > 0."""
        x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        return np.stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy], -1)

    def pixels_of(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the pixels (n, 2) as (u, v) that `points` (n, 3) fall on, camera frame.

        And which of them (n,) fall into the image; the pixel of a point behind the camera is -1.
        """
        # An axis at a time, each in one piece: half the time of rows of three.
        x, y, z = np.ascontiguousarray(points.T, np.float64)
        before = z > 0
        away = np.where(before, z, 1.0)
        u = np.where(before, np.round(self.fx * x / away + self.cx), -1.0)
        v = np.where(before, np.round(self.fy * y / away + self.cy), -1.0)
        inside = (u >= 0) & (u < self.width) & (v >= 0) & (v < self.height)
        pixels = np.stack([u, v]).astype(np.int64).T
        return pixels, inside

    def rays(self) -> Array:
        """Return (H, W, 3) points on each pixel's ray at depth 1, camera frame."""
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        x, y = (u - self.cx) / self.fx, (v - self.cy) / self.fy
        return np.stack([x, y, np.ones_like(x)], -1)

    def backproject(self, depth: ArrayLike) -> Array:
        """Return (H, W, 3) points, camera frame, of `depth` (H, W) in metres; nan where missing."""
        depth = np.asarray(depth, np.float64)
        if depth.shape != (self.height, self.width):
            raise ValueRangeError("depth size", depth.shape, f"{(self.height, self.width)}")
        # An axis at a time: half the time of rays, as rows of three, times depth.
        points = np.empty((*depth.shape, 3))
        points[..., 2] = z = np.where(depth > 0, depth, np.nan)
        np.multiply((np.arange(self.width) - self.cx) / self.fx, z, out=points[..., 0])
        np.multiply(((np.arange(self.height) - self.cy) / self.fy)[:, None], z, out=points[..., 1])
        return points

    def resized(self, width: int, height: int) -> "Intrinsics":
        """Return the intrinsics of the same image resampled to `width` x `height`."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * sx,
            fy=self.fy * sy,
            # Pixel centres, not corners, are whole numbers: hence the halves.
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            width=width,
            height=height,
        )
