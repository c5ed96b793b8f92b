"""Organised point clouds, `.pcd`: a point per pixel, row by row, metres in the camera frame.

The file has no intrinsics; they follow from the points, by least squares, to the last digit. Clouds
of cameras that measure in the images of a lens, not in rectified images, give its distortion too.
"""

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pipelines.array_types import Array
from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.cameras.lens import BROWN, NO_DISTORTION, Distortion
from pipelines.frames.encodings.pcd_files import read_pcd
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.rgbd import Frame, make_frame

LARGEST_MISFIT = 0.5  # pixels between a point's projection and its place in the grid
FEWEST_POINTS = 100
STEEPEST = 100.0  # slope of a ray: beyond, no camera sees
LENS_POINTS = 4000  # points that the distortion is fitted to
NO_PINHOLE = "its points are not those of a pinhole camera, pixel by pixel"
SAVED_SO = "save the organised cloud in the camera frame, not turned"


def _find(folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
    """Yield the `.pcd` files of `folder`, each one frame."""
    for path in sorted(folder.glob("*.pcd")):
        yield FoundFrame(path.stem, functools.partial(_read, path, options), (path,))


def fit_camera(path: Path, points: Array) -> CameraFile:
    """Return the camera that sees `points` (H, W, 3), in any unit, each in its own pixel.

    It is a pinhole camera, or, where none fits, one with a lens of the Brown-Conrady model.

    Raises:
        FormatError: no such camera exists: the cloud was cropped, turned, or is not organised.
    """
    height, width = points.shape[:2]
    seen = np.isfinite(points).all(2) & (points[:, :, 2] > 0)
    rows, columns = np.nonzero(seen)
    if len(rows) < FEWEST_POINTS:
        found = f"{len(rows)} points are in front of the camera"
        raise FormatError(path, found, f"at least {FEWEST_POINTS} are needed; measure again")
    pixels = np.column_stack([columns, rows]).astype(np.float64)
    with np.errstate(over="ignore"):  # infinite slopes are in no pixel
        slopes = points[seen][:, :2] / points[seen][:, 2:]
    if not (np.abs(slopes) <= STEEPEST).all():
        raise FormatError(path, NO_PINHOLE, SAVED_SO)
    values = _fit_pinhole(slopes, pixels)
    if np.abs(_projected(values, slopes) - pixels).max() > LARGEST_MISFIT:
        values = _fit_lens(values, slopes, pixels)
    fx, fy, cx, cy, *lens = values.tolist()
    if np.abs(_projected(values, slopes) - pixels).max() > LARGEST_MISFIT or min(fx, fy) <= 0:
        raise FormatError(path, NO_PINHOLE, SAVED_SO)
    distortion = Distortion(BROWN, tuple(lens)) if any(lens) else NO_DISTORTION
    return CameraFile(fx, fy, cx, cy, width, height, origin=str(path), distortion=distortion)


def _fit_pinhole(slopes: Array, pixels: Array) -> Array:
    """Return fx, fy, cx, cy and five zeros for the pinhole camera nearest to slopes (n, 2)."""
    both = [
        np.linalg.lstsq(np.column_stack([slope, np.ones_like(slope)]), place, rcond=None)[0]
        for slope, place in zip(slopes.T, pixels.T, strict=True)
    ]
    return np.concatenate([*zip(*both, strict=True), np.zeros(5)])


def _fit_lens(start: Array, slopes: Array, pixels: Array) -> Array:
    """Return fx, fy, cx, cy, k1, k2, p1, p2, k3 of the camera nearest to slopes (n, 2)."""
    some = slice(None, None, -(-len(slopes) // LENS_POINTS))

    def misfits(values: Array) -> Array:
        return (_projected(values, slopes[some]) - pixels[some]).ravel()

    return np.asarray(least_squares(misfits, start, x_scale="jac").x)


def _projected(values: Array, slopes: Array) -> Array:
    """Return the pixels (n, 2) of rays with these slopes; `values` as in `_fit_lens`."""
    fx, fy, cx, cy = values[:4]
    matrix, still = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), np.zeros(3)
    rays = np.column_stack([slopes, np.ones(len(slopes))])
    return np.asarray(cv2.projectPoints(rays, still, still, matrix, values[4:])[0][:, 0])


def _read(path: Path, options: FrameOptions) -> Frame:
    fields = read_pcd(path)
    if not set("xyz") <= set(fields):
        raise FormatError(path, f"has the fields {', '.join(fields)}", "x, y, z are needed")
    if min(fields["x"].shape) < 2:
        found = "is a list of points, not one point a pixel"
        raise FormatError(path, found, "an organised cloud (HEIGHT above 1) is expected")
    with np.errstate(over="ignore", invalid="ignore"):
        points = np.stack([fields[axis].astype(np.float64) for axis in "xyz"], axis=2)
    packed = next((fields[key] for key in ("rgb", "rgba") if key in fields), None)
    color = None if packed is None else functools.partial(_unpacked, path, packed)
    camera = options.camera or fit_camera(path, points)
    depth = (path, points[:, :, 2].astype(np.float32))
    return make_frame((path, color), depth, camera, options.depth_units())


def _unpacked(path: Path, packed: NDArray[Any]) -> NDArray[np.uint8]:
    """Return (H, W, 3) RGB of colours packed into the bits of one number each."""
    if packed.dtype.itemsize != 4:
        found = f"has colours of {packed.dtype}"
        raise FormatError(path, found, "four bytes a point are expected")
    bits = np.ascontiguousarray(packed).view(np.uint32)
    return np.stack([bits >> shift & 255 for shift in (16, 8, 0)], axis=2).astype(np.uint8)


LAYOUT = Layout("organised point cloud", _find)
