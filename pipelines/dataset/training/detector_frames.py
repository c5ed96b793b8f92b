"""Cache of the detector's training: small frames with their regions, one file per scene.

`finetune-detector` renders region masks once and trains on them many times. Camera frame (OpenCV
axes).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Singles
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.pointcloud import Plane
from pipelines.storage.h5_columns import check_version
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import Stamp
from pipelines.tabletop.depth_channels import SmallFrame

FORMAT_VERSION = 1
DEPTH_UNITS = 10_000.0  # per metre: tenths of a millimetre
GZIP_LEVEL = 1  # the fastest; 4 saves a twentieth (docs/experiments/training.md)
MAX_DEPTH = 6.5  # metres; larger depths are stored as missing


@dataclass(frozen=True)
class DetectorFrame:
    """A small frame, its support plane, and its regions (h, w) uint8, 0 = none."""

    frame: SmallFrame
    plane: Plane
    regions: NDArray[np.uint8]


def write(path: Path, frames: list[DetectorFrame], stamp: Stamp) -> None:
    """Write a scene's frames, all of one size."""
    with new_h5(path) as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["provenance"] = stamp.as_text()
        cameras = [each.frame.intrinsics for each in frames]
        _images(file, "color", [each.frame.color for each in frames])
        _images(file, "depth", [_packed_depth(each.frame.depth) for each in frames])
        _images(file, "regions", [each.regions for each in frames])
        planes = [[*each.plane.normal, each.plane.offset] for each in frames]
        file["plane"] = np.reshape(np.array(planes, np.float64), (-1, 4))
        numbers = [[camera.fx, camera.fy, camera.cx, camera.cy] for camera in cameras]
        file["intrinsics"] = np.reshape(np.array(numbers, np.float64), (-1, 4))
        if frames:
            file["depth"].attrs["units"] = "0.1 mm"


def count_frames(path: Path) -> int:
    """Return the number of frames in a file."""
    with open_h5(path) as file:
        check_version(path, file.attrs.get("format_version"), FORMAT_VERSION)
        return int(file["plane"].shape[0])


def read(path: Path, row: int) -> DetectorFrame:
    """Read one frame of a scene."""
    with open_h5(path) as file:
        check_version(path, file.attrs.get("format_version"), FORMAT_VERSION)
        color, regions = file["color"][row], file["regions"][row]
        depth = file["depth"][row].astype(np.float32) / np.float32(DEPTH_UNITS)
        plane, numbers = file["plane"][row], file["intrinsics"][row]
    fx, fy, cx, cy = numbers.tolist()
    intrinsics = Intrinsics(fx, fy, cx, cy, width=depth.shape[1], height=depth.shape[0])
    return DetectorFrame(
        SmallFrame(color, depth, intrinsics), Plane(plane[:3], float(plane[3])), regions
    )


def _images(file: h5py.File, name: str, images: list[NDArray[Any]]) -> None:
    if not images:
        return
    stack = np.stack(images)
    # Not LZF: its bytes depend on earlier contents of the memory.
    file.create_dataset(
        name,
        data=stack,
        chunks=(1, *stack.shape[1:]),
        compression="gzip",
        compression_opts=GZIP_LEVEL,
        track_times=False,
    )


def _packed_depth(depth: Singles) -> NDArray[np.uint16]:
    known = np.where((depth > 0) & (depth < MAX_DEPTH), depth, 0.0)
    return np.asarray(np.round(known * DEPTH_UNITS), np.uint16)
