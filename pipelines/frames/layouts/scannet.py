"""ScanNet's export: colour and depth from one viewpoint, each with its own camera.

The ratio of their sizes is no whole number (1296x968 to 640x480), so colour is sampled along the
ray of each depth pixel. Depth that is aligned to the colour has the camera of the colour.
"""

import functools
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.frames.cameras.camera_files import CameraFile, read_camera_file
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.layouts.paired import read_paired
from pipelines.frames.pairing.image_names import view_of
from pipelines.frames.pairing.image_pairs import ImagePair, sister_pairs
from pipelines.frames.rgbd import Frame, make_frame, read_color, stored_depth
from pipelines.geometry.camera import Intrinsics

DEPTH_CAMERA, COLOR_CAMERA = "intrinsic/intrinsic_depth.txt", "intrinsic/intrinsic_color.txt"


def _find(folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
    """Yield the frames of a scene."""
    cameras = (folder / DEPTH_CAMERA, folder / COLOR_CAMERA)
    if not cameras[0].is_file():
        return
    present = [path for path in cameras if path.is_file()]
    for pair in sister_pairs(folder):
        read = functools.partial(_read, pair, cameras, options)
        files = (pair.color, pair.depth, *present)
        yield FoundFrame(pair.stem, read, files, is_whole=pair.is_whole)


def seen_by(color: NDArray[np.uint8], camera: CameraFile, other: Intrinsics) -> NDArray[np.uint8]:
    """Return `color` (H, W, 3) of `camera`, sampled along the rays of `other`, black outside."""
    x, y, _one = np.moveaxis(other.rays(), 2, 0)
    u = (camera.fx * x + camera.cx).astype(np.float32)
    v = (camera.fy * y + camera.cy).astype(np.float32)
    return np.asarray(cv2.remap(color, u, v, cv2.INTER_LINEAR), np.uint8)


def _read(pair: ImagePair, cameras: tuple[Path, Path], options: FrameOptions) -> Frame:
    has_color = cameras[1].is_file()
    if pair.rivals or pair.color is None or pair.depth is None:
        return read_paired(pair, None, options)
    if view_of(pair.color, pair.depth) == "color":
        return read_paired(pair, cameras[1] if has_color else None, options)
    if not has_color:
        return read_paired(pair, cameras[0], options)
    color, depth = read_color(pair.color), stored_depth(pair.depth)
    camera = options.camera or read_camera_file(cameras[0])
    notes: tuple[str, ...] = ()
    if depth.ndim == 2 and color.shape[:2] != depth.shape:
        notes = (f"colour of {color.shape[1]}x{color.shape[0]} is sampled through both cameras",)
        color = seen_by(color, read_camera_file(cameras[1]), camera.at(*depth.shape[::-1]))
    images = (pair.color, lambda: color), (pair.depth, depth)
    return make_frame(*images, camera, options.depth_units(), notes)


LAYOUT = Layout("ScanNet", _find)
