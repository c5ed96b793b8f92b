"""The pinhole camera: intrinsics, projection, backprojection. OpenCV axes, no distortion."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices, Mask
from pipelines.contents import MAX_PIXELS
from pipelines.errors import ValueRangeError
from pipelines.geometry.numerics.compiled import compiled

Lens = tuple[float, float, float, float]  # fx, fy, cx, cy


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
        lens = self.fx, self.fy, self.cx, self.cy
        if not (np.isfinite(lens).all() and min(self.fx, self.fy) > 0):
            raise ValueRangeError("intrinsics", lens, "finite fx, fy > 0, cx, cy in pixels")
        size = (self.width, self.height)
        if min(size) < 1 or self.width * self.height > MAX_PIXELS:
            raise ValueRangeError("image size", size, f"positive, {MAX_PIXELS} pixels at most")

    @classmethod
    def from_matrix(cls, K: ArrayLike, width: int, height: int) -> "Intrinsics":
        """Return the intrinsics of the (3, 3) camera matrix `K`."""
        K = np.asarray(K, np.float64)
        return cls(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), width, height)

    @property
    def matrix(self) -> Array:
        """The (3, 3) camera matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def lens(self) -> Lens:
        """Focal lengths and principal point (fx, fy, cx, cy), as arguments of compiled loops."""
        return float(self.fx), float(self.fy), float(self.cx), float(self.cy)

    @property
    def image_plane(self) -> tuple[Array, Array]:
        """Coordinates x (W,) of the columns and y (H,) of the rows at depth 1, camera frame."""
        u, v = np.arange(self.width, dtype=np.float64), np.arange(self.height, dtype=np.float64)
        return (u - self.cx) / self.fx, (v - self.cy) / self.fy

    def project(self, points: ArrayLike) -> Array:
        """Return the pixels (..., 2) as (u, v) of `points` (..., 3), camera frame, z > 0."""
        x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        return np.stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy], -1)

    def pixels_of(self, points: Array) -> tuple[Indices, Mask]:
        """Return the nearest pixels (n, 2) as (u, v) of `points` (n, 3), camera frame.

        The mask (n,) is true inside the image; the pixel of a point behind the camera is -1.
        """
        rows = np.ascontiguousarray(points, np.float64)
        return _pixels(rows, self.lens, int(self.width), int(self.height))

    def points_at(self, pixels: Array, z: Array) -> Array:
        """Return the points (n, 3) at depths `z` (n,) on `pixels` (n, 2) as (u, v)."""
        x, y = (pixels[:, 0] - self.cx) / self.fx * z, (pixels[:, 1] - self.cy) / self.fy * z
        return np.stack([x, y, z], axis=1)

    def rays(self) -> Array:
        """Return the points (H, W, 3) at depth 1 on the rays of the pixels, camera frame."""
        x, y = np.meshgrid(*self.image_plane)
        return np.stack([x, y, np.ones_like(x)], -1)

    def backproject(self, depth: ArrayLike) -> Array:
        """Return the points (H, W, 3) of `depth` (H, W), metres, camera frame; nan where 0."""
        depth = np.asarray(depth, np.float64)
        if depth.shape != (self.height, self.width):
            raise ValueRangeError("depth size", depth.shape, f"{(self.height, self.width)}")
        return _points(np.ascontiguousarray(depth), *self.image_plane)

    def resized(self, width: int, height: int) -> "Intrinsics":
        """Return the intrinsics of the same image resampled to `width` x `height`."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * sx,
            fy=self.fy * sy,
            # Pixel centres, not pixel corners, are at whole numbers.
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
            width=width,
            height=height,
        )


@compiled
def _pixels(points: Array, lens: Lens, width: int, height: int) -> tuple[Indices, Mask]:
    fx, fy, cx, cy = lens
    pixels, inside = np.empty((len(points), 2), np.int64), np.empty(len(points), np.bool_)
    for n in range(len(points)):
        z = points[n, 2]
        away = z if z > 0 else 1.0
        u = np.rint(fx * points[n, 0] / away + cx) if z > 0 else -1.0
        v = np.rint(fy * points[n, 1] / away + cy) if z > 0 else -1.0
        inside[n] = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        pixels[n, 0], pixels[n, 1] = int(u), int(v)
    return pixels, inside


@compiled
def _points(depth: Array, x: Array, y: Array) -> Array:
    """Return the points (h, w, 3) of `depth` (h, w); `x` (w,) and `y` (h,): the image plane."""
    points = np.empty((len(y), len(x), 3))
    for row in range(len(y)):
        for column in range(len(x)):
            z = depth[row, column] if depth[row, column] > 0 else np.nan
            points[row, column, 0] = x[column] * z
            points[row, column, 1] = y[row] * z
            points[row, column, 2] = z
    return points
