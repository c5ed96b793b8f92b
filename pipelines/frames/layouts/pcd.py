"""Organised point clouds, `.pcd`: a point per pixel, row by row, metres in the camera frame.

The file has no intrinsics; they follow from the points, by least squares, to the last digit.
"""

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.errors import FormatError
from pipelines.frames.camera_files import CameraFile
from pipelines.frames.encodings.pcd_files import read_pcd
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.rgbd import Frame, make_frame
from pipelines.frames.rgbd_folder import FrameOptions

GREY = 128
LARGEST_MISFIT = 0.5  # pixels between a point's projection and its place in the grid
FEWEST_POINTS = 100
NO_PINHOLE = "its points are not those of a pinhole camera, pixel by pixel"
SAVED_SO = "save the organised cloud in the camera frame, not turned"


def _find(folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
    """Yield the `.pcd` files of `folder`, each one frame."""
    for path in sorted(folder.glob("*.pcd")):
        yield FoundFrame(path.stem, functools.partial(_read, path, options), (path,))


def fit_camera(path: Path, points: Array) -> CameraFile:
    """Return the pinhole camera that sees `points` (H, W, 3), metres, each in its own pixel.

    Raises:
        FormatError: no such camera exists: the cloud was cropped, turned, or is not organised.
    """
    height, width = points.shape[:2]
    seen = np.isfinite(points).all(2) & (points[:, :, 2] > 0)
    rows, columns = np.nonzero(seen)
    if len(rows) < FEWEST_POINTS:
        found = f"{len(rows)} points are in front of the camera"
        raise FormatError(path, found, f"at least {FEWEST_POINTS} are needed; measure again")
    x, y, z = points[seen].T
    lengths, misfits = [], []
    with np.errstate(over="ignore"):  # infinite slopes are in no pixel
        both = (columns, x / z), (rows, y / z)
    if not np.isfinite([slopes for _pixels, slopes in both]).all():
        raise FormatError(path, NO_PINHOLE, SAVED_SO)
    for pixels, slopes in both:
        system = np.column_stack([slopes, np.ones(len(slopes))])
        solution = np.linalg.lstsq(system, pixels.astype(np.float64), rcond=None)[0]
        lengths.append(solution)
        misfits.append(float(np.abs(system @ solution - pixels).max()))
    (fx, cx), (fy, cy) = lengths
    if not (max(misfits) <= LARGEST_MISFIT and min(fx, fy) > 0):
        raise FormatError(path, NO_PINHOLE, SAVED_SO)
    return CameraFile(float(fx), float(fy), float(cx), float(cy), width, height, origin=str(path))


def _read(path: Path, options: FrameOptions) -> Frame:
    fields = read_pcd(path)
    if not set("xyz") <= set(fields):
        raise FormatError(path, f"has the fields {', '.join(fields)}", "x, y, z are needed")
    if min(fields["x"].shape) < 2:
        found = "is a list of points, not one point a pixel"
        raise FormatError(path, found, "an organised cloud (HEIGHT above 1) is expected")
    with np.errstate(over="ignore", invalid="ignore"):
        points = np.stack([fields[axis].astype(np.float64) for axis in "xyz"], axis=2)
    notes: tuple[str, ...] = ()
    packed = next((fields[key] for key in ("rgb", "rgba") if key in fields), None)
    if packed is None:
        notes = ("has no colour (rgb or rgba); grey is taken",)
        color = np.full(points.shape, GREY, np.uint8)
    else:
        color = _unpacked(path, packed)
    camera = options.camera or fit_camera(path, points)
    depth = (path, points[:, :, 2].astype(np.float32))
    return make_frame((path, lambda: color), depth, camera, options.depth_units(), notes)


def _unpacked(path: Path, packed: NDArray[Any]) -> NDArray[np.uint8]:
    """Return (H, W, 3) RGB of colours packed into the bits of one number each."""
    if packed.dtype.itemsize != 4:
        found = f"has colours of {packed.dtype}"
        raise FormatError(path, found, "four bytes a point are expected")
    bits = np.ascontiguousarray(packed).view(np.uint32)
    return np.stack([bits >> shift & 255 for shift in (16, 8, 0)], axis=2).astype(np.uint8)


LAYOUT = Layout("organised point cloud", _find)
