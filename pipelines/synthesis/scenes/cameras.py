"""Viewpoints of cameras around a table, and their lenses."""

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array
from pipelines.errors import UnknownNameError
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.transforms import make_pose, rotation_about, unit

# GraspNet-1Billion's cameras: fx, fy, cx, cy in pixels.
LENSES = {
    "kinect": (631.54864502, 631.20751953, 638.43517329, 366.49904066),
    "realsense": (927.16973877, 927.36688232, 651.31506348, 349.62133789),
}
LENS_WIDTH, LENS_HEIGHT = 1280, 720  # pixels, of the images of these lenses
MIXED = "mixed"  # each scene draws kinect or realsense
ELEVATIONS = (np.radians(32.0), np.radians(75.0))
DISTANCES = (0.45, 0.9)  # metres; the near end for the long lens
MAX_ROLL = np.radians(8.0)


def camera_folder(sensor: str) -> str:
    """Return the name of GraspNet's camera folder for `sensor`: kinect, else realsense."""
    if sensor not in {*LENSES, "perfect"}:
        raise UnknownNameError("sensor", sensor, [*LENSES, "perfect"])
    return "kinect" if sensor == "kinect" else "realsense"


def sensor_intrinsics(sensor: str, width: int, height: int) -> Intrinsics:
    """Return the intrinsics of `sensor` at another size; the horizontal field of view stays."""
    fx, fy, cx, cy = LENSES[camera_folder(sensor)]
    scale = width / LENS_WIDTH
    middle = (cy - LENS_HEIGHT / 2) * scale + height / 2
    return Intrinsics(fx * scale, fy * scale, cx * scale, middle, width, height)


def direction_at(azimuth: float, elevation: float) -> Array:
    """Return the unit vector (3,) at these angles, radians, z up."""
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def look_at(eye: ArrayLike, target: ArrayLike, roll: float = 0.0) -> Array:
    """Return `T_world_cam` (4, 4) of a camera at `eye` (3,) looking at `target` (3,), z up."""
    forward = unit(np.asarray(target, np.float64) - np.asarray(eye, np.float64))
    right = unit(np.cross(forward, [0.0, 0.0, 1.0]))
    rotation = np.stack([right, np.cross(forward, right), forward], -1)
    return make_pose(rotation @ rotation_about([0, 0, 1], roll), eye)


def drawn_viewpoints(
    center: ArrayLike,  # metres, table frame
    count: int,
    intrinsics: Intrinsics,
    rng: np.random.Generator,
    arc: tuple[float, float] | None = None,  # azimuth's middle, half width, radians; None: all
    elevations: tuple[float, float] | None = None,  # lowest, highest, radians; None: `ELEVATIONS`
) -> Array:
    """Return poses T_table_cam (count, 4, 4) spread around `center` (3,), all above it."""
    # A camera with a long lens is farther away, so that it sees an equal part of the table.
    near, far = np.array(DISTANCES) * np.clip(intrinsics.fx / intrinsics.width / 0.7, 0.7, 1.3)
    shares = (np.arange(count) + 0.5) / count
    azimuths = rng.uniform(0, 2 * np.pi) + 2 * np.pi * shares
    if arc is not None:
        middle, half = arc
        azimuths = middle + half * (2 * shares - 1) + rng.uniform(-half, half, count) / count
    low, high = elevations or ELEVATIONS
    poses = []
    for azimuth in azimuths:
        elevation, distance = rng.uniform(low, high), rng.uniform(near, far)
        target = np.asarray(center, np.float64) + rng.normal(0.0, 0.03, 3) * [1, 1, 0]
        eye = target + distance * direction_at(azimuth, elevation)
        poses.append(look_at(eye, target, rng.uniform(-MAX_ROLL, MAX_ROLL)))
    return np.stack(poses)
