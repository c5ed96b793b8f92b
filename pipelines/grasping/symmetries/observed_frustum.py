"""The part of space that the depth image does not exclude: on and behind the surface (D. 6)."""

import numpy as np

from pipelines.array_types import Array, Indices, Mask
from pipelines.geometry.numerics.compiled import compiled
from pipelines.geometry.numerics.quantiles import median
from pipelines.grasping.scene import SceneCloud


def in_observed_frustum(points: Array, scene: SceneCloud) -> Mask:
    """Return a mask of `points` (n, 3) that the depth image does not exclude (Sec. III-F).

    A point must project into the image and be on or behind the surface seen there, within the
    sensor's tolerance and noise, sideways as well as in depth. A point without a measurement at
    its pixel is not excluded.
    """
    pixels, inside = scene.intrinsics.pixels_of(points)
    z = np.ascontiguousarray(points[:, 2], np.float64)
    if not inside.any():
        return inside
    tolerance, noise = scene.sensor.behind_tolerance, scene.sensor.depth_noise
    reach = tolerance * scene.intrinsics.fx / float(median(z[inside]))
    reach = min(reach, scene.intrinsics.width)  # unbounded for points at the lens
    radius = max(1, round(reach))
    return _may_be_real(z, pixels, inside, scene.depth, radius, (tolerance, noise))


@compiled
def _may_be_real(
    z: Array, pixels: Indices, inside: Mask, depth: Array, radius: int, noise: tuple[float, float]
) -> Mask:
    """Return a mask of points at depth `z` (n,) that a surface within `radius` pixels may hide.

    Points without a measurement nearby count too. `noise`: tolerance, and factor of z^2.
    """
    height, width = depth.shape
    real = inside.copy()
    for n in range(len(z)):
        if not inside[n]:
            continue
        column, row = pixels[n, 0], pixels[n, 1]
        farthest = z[n] + noise[0] + noise[1] * (z[n] * z[n])
        if 0 < depth[row, column] < farthest:
            continue
        measured, before = 0, 0
        left, right = max(column - radius, 0), min(column + radius + 1, width)
        for i in range(max(row - radius, 0), min(row + radius + 1, height)):
            for j in range(left, right):
                measured += depth[i, j] > 0
                before += (depth[i, j] > 0) & (depth[i, j] < farthest)
            if before:
                break
        real[n] = before > 0 or measured == 0
    return real
