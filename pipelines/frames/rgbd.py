"""One RGB-D frame, read from a colour and a depth file, with every common fault detected.

The depth of a frame is float32 metres with 0 = missing: 0, NaN, infinities, negative values and,
among whole numbers, 65535 in the file all mean missing; so does depth beyond 100 m.
"""

import functools
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Singles
from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.cameras.camera_search import where_a_camera_may_be
from pipelines.frames.cameras.lens import Distortion, Image, displacement, distorted, undistorted
from pipelines.frames.depth.depth_checks import (
    LOOKS_INVERSE,
    MISSING_DEPTH,
    has_rotated_bits,
    is_inverse,
    nothing_measured,
    one_channel,
)
from pipelines.frames.encodings.exif import turned_like_depth
from pipelines.frames.encodings.exr_files import read_exr
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.numerics.strides import strided_at_least
from pipelines.storage.array_files import read_npy, read_npz
from pipelines.storage.images import read_image

log = logging.getLogger(__name__)

CANDIDATE_UNITS = (1000.0, 10000.0, 5000.0, 1.0)  # mm; 0.1 mm; TUM; metres
CENTIMETRES = 100.0  # of some renderers
NEAREST_SHARE = 0.3  # far background must not hide a table near the camera
GREY = 128
SAMPLE = 20_000  # pixels are enough for a median
LIKELY_DEPTH = (0.15, 4.0)  # m, of the median of the nearest share
CLOSEST_DEPTH = 0.05  # m, of the same; a RealSense D405 on a wrist measures from 0.07
FARTHEST_DEPTH = 100.0  # m; farther numbers stand for missing depth, as Blender's 1e10


@dataclass(frozen=True)
class Frame:
    """One registered RGB-D frame."""

    name: str
    color: NDArray[np.uint8]  # (H, W, 3) RGB
    depth: Singles  # (H, W) metres along the optical axis, 0 = missing
    intrinsics: Intrinsics
    units_per_metre: float | None = None  # divisor of the file's numbers, if known
    notes: tuple[str, ...] = ()  # oddities, a sentence each
    removed: Distortion | None = None  # lens distortion that only the files' images have

    def undistorted(self, ids: Image) -> Image:
        """Return an image (H, W) of ids without the lens distortion that the frame lacks too."""
        if self.removed is None:
            return ids
        return undistorted(ids, self.intrinsics, self.removed, smooth=False)

    def distorted(self, image: Image) -> Image:
        """Return an image (H, W) or (H, W, 3) of this frame's pixels in those of its files."""
        return image if self.removed is None else distorted(image, self.intrinsics, self.removed)


@dataclass(frozen=True)
class FrameSource:
    """A frame that can be read: `read()` raises a SymgraspError if this frame is faulty."""

    name: str  # relative to the folder that was searched, with forward slashes
    read: Callable[[], Frame]
    files: tuple[Path, ...] = ()  # the frame's existing files, colour first
    layout: str = ""  # the name of the layout it was found in
    is_whole: bool = True  # False for an image without its partner, which may be no frame at all


def read_color(path: Path) -> NDArray[np.uint8]:
    """Read a colour image as (H, W, 3) RGB; grey images are repeated in three channels."""
    return as_color(path, read_image(path))


def as_color(path: Path, image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the `image` in `path` as (H, W, 3) RGB; see `read_color`."""
    if image.dtype != np.uint8:
        raise FormatError(path, f"a colour image of {image.dtype}", "8 bit is expected")
    if image.ndim == 2:
        image = np.repeat(image[:, :, None], 3, axis=2)
    return image[:, :, :3]


@dataclass(frozen=True)
class DepthUnits:
    """Units per metre of a depth file's numbers: of whole numbers, and of floats."""

    integers: float = 1000.0
    floats: float = 1.0  # depth stored as floats is usually metres
    far_floats: float | None = None  # of floats beyond LIKELY_DEPTH as metres, if a file states it
    option: str = "--depth-units-per-metre"  # by which a user states other units
    is_stated: bool = False  # stated by the user: a close view is no reason for doubt
    is_certain: bool = False  # stated by a data set: no depth is a reason for doubt


def read_depth(path: Path, units: DepthUnits) -> Singles:
    """Read a depth image (H, W) in metres, 0 = missing.

    Args:
        path: 16-bit PNG or TIFF, float TIFF, EXR, `.npy`, or `.npz` with one array.
        units: the unit of the file's numbers.

    Raises:
        FormatError: colourised, 8 bit, damaged, empty, or in an implausible unit.
    """
    return _metres(path, stored_depth(path), units)[0]


def read_pair(
    color_path: Path, depth_path: Path, camera: CameraFile | None, units: DepthUnits
) -> Frame:
    """Read a frame from its two images; see `make_frame`."""
    color = functools.partial(read_color, color_path)
    stored = stored_depth(depth_path)
    return make_frame((color_path, color), (depth_path, stored), camera, units)


def make_frame(
    color: tuple[Path, Callable[[], NDArray[np.uint8]] | None],
    depth: tuple[Path, NDArray[Any]],
    camera: CameraFile | None,
    units: DepthUnits,
    notes: tuple[str, ...] = (),
) -> Frame:
    """Make a frame from the content of files, without the camera's lens distortion (D. 125).

    The frame has no name yet. The depth is checked first: its faults matter most.

    Args:
        color: the file, and a function that reads (H, W, 3) RGB, None for grey; resampled to the
            depth's size.
        depth: the file, and the numbers in it.
        camera: camera of the depth; None if it is unknown, which is an error.
        units: see `read_depth`.
        notes: oddities of the frame.

    Raises:
        FormatError: no camera, a fault of the depth (see `read_depth`), or colour whose sides have
            another ratio than those of the depth.
    """
    measured, unit = _metres(*depth, units)
    height, width = measured.shape
    if camera is None:
        found = "no intrinsics are known for this frame"
        raise FormatError(color[0], found, where_a_camera_may_be(color[0]))
    intrinsics = camera.at(width, height)
    path, read = color
    if read is None:
        notes += ("has no colour; grey is taken",)
    stored = np.full((height, width, 3), GREY, np.uint8) if read is None else read()
    image, turned = turned_like_depth(path, stored, height, width)
    fitted = fit_color(path, image, width, height)
    if fitted is not image:
        notes += (f"colour of {image.shape[1]}x{image.shape[0]} is resampled to the depth",)
    notes += (*turned, *_close_views(measured))
    frame = Frame("", fitted, measured, intrinsics, unit, notes)
    return _without_distortion(frame, camera)


def _without_distortion(frame: Frame, camera: CameraFile) -> Frame:
    distortion = camera.distortion
    if not distortion.is_known:
        note = f"the lens distortion is of the unknown model {distortion.model} and stays"
        return replace(frame, notes=(*frame.notes, note))
    moved = displacement(frame.intrinsics, distortion)
    if not moved:
        return frame
    note = f"lens distortion ({distortion.model}) is removed: pixels move by up to {moved:.0f}"
    depth = undistorted(frame.depth, frame.intrinsics, distortion, smooth=False)
    if not depth.any():
        found = "its lens distortion moves every measured pixel out of the image"
        raise FormatError(camera.origin, found, "check the coefficients")
    color = undistorted(frame.color, frame.intrinsics, distortion, smooth=True)
    return replace(frame, color=color, depth=depth, notes=(*frame.notes, note), removed=distortion)


def fit_color(path: Path, color: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """Return `color` at the depth's size; only sizes of one ratio may be resampled."""
    if color.shape[:2] == (height, width):
        return color
    found = f"colour is {color.shape[1]}x{color.shape[0]}, depth is {width}x{height}"
    if color.shape[0] * width != color.shape[1] * height:
        raise FormatError(path, found, "register them to one size, or to sizes of one ratio")
    log.info("%s: %s; colour is resampled to the depth", path, found)
    method = cv2.INTER_AREA if color.shape[0] > height else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(color, (width, height), interpolation=method), dtype=np.uint8)


def _metres(path: Path, stored: NDArray[Any], units: DepthUnits) -> tuple[Singles, float]:
    """Return depth (H, W) in metres, 0 = missing, and its unit, from the numbers in `path`."""
    stored = one_channel(path, stored)
    is_float = stored.dtype.kind == "f"
    with np.errstate(over="ignore"):  # too large for float32 is infinite, hence missing
        values = stored.astype(np.float32, order="C")
    valid = np.isfinite(values) & (values > 0)
    if not is_float:
        valid &= stored != MISSING_DEPTH
    if not valid.any():
        raise FormatError(path, *nothing_measured(stored))
    values[~valid] = 0.0
    unit = units.floats if is_float else units.integers
    if is_float and units.far_floats is not None and _nearest_median(values) > LIKELY_DEPTH[1]:
        unit = units.far_floats
    depth = values / np.float32(unit)
    if not units.is_certain:
        _check_plausible(path, values, depth, units)
    if (is_near := depth <= FARTHEST_DEPTH).any():
        depth[~is_near] = 0.0
    return depth, unit


def stored_depth(path: Path) -> NDArray[Any]:
    """Return the numbers of a depth file as stored; see `read_depth` for the kinds."""
    match path.suffix.lower():
        case ".npy":
            return read_npy(path)
        case ".npz":
            arrays = read_npz(path)
            if not arrays or (len(arrays) != 1 and "depth" not in arrays):
                raise FormatError(path, f"holds {sorted(arrays)}", "name one array `depth`")
            return arrays["depth"] if "depth" in arrays else next(iter(arrays.values()))
        case ".exr":
            return read_exr(path)
        case _:
            return read_image(path)


def _check_plausible(path: Path, values: NDArray[Any], depth: Singles, units: DepthUnits) -> None:
    """Raise FormatError where `depth` (H, W) looks like another unit, or like inverse depth.

    Depth that is closer than most cameras measure is no fault if no common unit is likelier.
    """
    if not units.is_stated and units.integers == DepthUnits().integers and has_rotated_bits(values):
        found = (
            "the numbers are multiples of 8: their bits were rotated (SUN RGB-D) or shifted by 3"
        )
        expected = f"rotate them back, or give {units.option} 8000 if nothing is beyond 8 m"
        raise FormatError(path, found, expected)
    near, far = LIKELY_DEPTH
    nearest, typical = _nearest_median(depth), _nearest_median(values)
    if near <= nearest <= far:
        return
    if is_inverse(depth):
        raise FormatError(path, f"the nearest depths are about {nearest:.4g} m", LOOKS_INVERSE)
    has_likelier = any(near <= typical / unit <= far for unit in CANDIDATE_UNITS)
    if CLOSEST_DEPTH <= nearest < near and (units.is_stated or not has_likelier):
        return
    options = ", ".join(
        f"{typical / unit:.4g} m under {unit:g}" for unit in (*CANDIDATE_UNITS, CENTIMETRES)
    )
    raise FormatError(
        path,
        f"the nearest depths are about {nearest:.4g} m, outside {near:g} to {far:g} m",
        f"give the units per metre with {units.option}: they would be {options}",
    )


def _close_views(depth: Singles) -> tuple[str, ...]:
    """Return a remark if `depth` (H, W) is closer than most cameras measure."""
    nearest = _nearest_median(depth)
    if nearest >= LIKELY_DEPTH[0]:
        return ()
    return (f"the nearest depths are about {nearest:.2g} m, closer than most cameras measure",)


def _nearest_median(depth: Singles) -> float:
    """Return the median of the nearest share of the depths (H, W); 0 = missing."""
    depth = depth[depth > 0]
    depth = strided_at_least(depth, SAMPLE)
    count = max(1, int(NEAREST_SHARE * depth.size))
    return float(np.median(np.partition(depth, count - 1)[:count]))
