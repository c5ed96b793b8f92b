"""BlenderProc: an HDF5 file for each frame.

    colors       (H, W, 3) uint8 RGB
    depth        (H, W) float metres along the optical axis, 1e10 for the sky
    camera_pose  JSON with `cam_K`, if written with `save_world2cam`; optional
    campose      JSON, a list with one such mapping, of version 1; optional

Without a camera in the file, the camera file next to it counts.
"""

import functools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.contents import json_value, reading
from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.arrays import camera_files, frame_of_arrays
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.rgbd import Frame
from pipelines.storage.h5_files import open_h5

COLOR, DEPTH, ALONG_RAY = "colors", "depth", "distance"
CAMERA_TEXTS = ("camera_pose", "campose")


def _find(folder: Path, options: FrameOptions) -> list[FoundFrame]:
    """List the frames of `folder`; damaged files are listed to be reported if it has frames."""
    files = sorted(path for path in folder.glob("[!.]*.hdf5") if path.is_file())
    names = {path: _datasets_in(path) for path in files}
    if not any(names.values()):
        return []
    listed = [path for path in files if names[path] or names[path] is None]
    cameras = camera_files(folder, listed)
    return [
        FoundFrame(
            path.stem,
            functools.partial(_read, path, options, cameras[path]),
            (path, cameras[path]),
        )
        for path in listed
    ]


def _datasets_in(path: Path) -> set[str] | None:
    """Return the names of the datasets of a frame, none of other content; None if damaged."""
    try:
        with open_h5(path) as file:
            names = set(file)
    except (SymgraspError, OSError):
        return None
    return names if COLOR in names and names & {DEPTH, ALONG_RAY} else set()


def _read(path: Path, options: FrameOptions, camera_file: Path | None) -> Frame:
    with open_h5(path) as file:
        names = [name for name in (COLOR, DEPTH, *CAMERA_TEXTS) if name in file]
        if DEPTH not in names:
            found = f"holds the distance along the rays (`{ALONG_RAY}`), and no depth"
            raise FormatError(path, found, "render with enable_depth_output")
        with reading(path, "a dataset", f"arrays {COLOR} and {DEPTH} are expected"):
            arrays = {name: np.asarray(file[name]) for name in names}
    name = next((name for name in CAMERA_TEXTS if name in arrays), None)
    matrix = None if name is None else _matrix(path, name, arrays[name])
    if matrix is not None:
        arrays["cam_K"] = matrix
    return frame_of_arrays(path, arrays, options, camera_file)


def _matrix(path: Path, name: str, text: NDArray[Any]) -> Array | None:
    """Return the matrix `cam_K` in the JSON `text` of the dataset `name`, None if it has none."""
    with reading(path, f"`{name}`", "JSON with cam_K is expected"):
        stated = json_value(path, bytes(text.item()), f"`{name}`")
        state = dict(stated[0] if isinstance(stated, list) else stated)
        return np.asarray(state["cam_K"], np.float64) if "cam_K" in state else None


LAYOUT = Layout("BlenderProc", _find)
