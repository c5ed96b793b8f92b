"""Contact-GraspNet's and 6-DOF GraspNet's frames: named arrays in one `.npz` per frame.

    depth              (H, W) float metres; whole numbers are millimetres
    K                  (3, 3); also `intrinsics_matrix`, `cam_K`, ..., or numbers `fx`, `fy`, ...;
                       without these, the camera file next to the `.npz` counts
    depth_scale, D     unit and lens distortion, by the keys of camera files; optional
    rgb                (H, W, 3) uint8 in the order **BGR**, as in Contact-GraspNet; optional
    image              (H, W, 3) uint8 RGB, as in 6-DOF GraspNet; also `color`, `colors`

Colours may also be floats from 0 to 1.

Their `.npy` files (and `.pkl`) are pickled dictionaries, which can run any code: they are refused,
with a sentence on how to convert them.
"""

import functools
import re
import zipfile
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.cameras.camera_files import (
    CameraFile,
    camera_from_mapping,
    read_camera_file,
    read_units,
    units_of,
)
from pipelines.frames.cameras.camera_search import (
    own_camera_file,
    shared_camera_file,
    where_a_camera_may_be,
)
from pipelines.frames.cameras.stated_cameras import SYNONYMS
from pipelines.frames.encodings.plain_pickle import read_plain_pickle
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.pairing.image_names import ALIGNED_DEPTH
from pipelines.frames.rgbd import Frame, make_frame
from pipelines.storage.array_files import DAMAGED, read_npz
from pipelines.storage.files import existing

NAME = "Contact-GraspNet / 6-DOF GraspNet arrays"
PICKLED_NAME = "Contact-GraspNet / 6-DOF GraspNet pickles"
CAMERA_KEYS = (
    *("K", "intrinsics_matrix", "intrinsic_matrix", "cam_K"),
    *("intrinsics", "intrinsic", "camera_matrix"),
)
COLOR_KEYS = ("rgb", "image", "color", "colors")  # of the first the order is BGR
CLOUD_KEYS = ("xyz", "xyz_color")
MOST_NUMBERS = 16  # of a camera's array: a 4x4 matrix; a lens has 14
OBJECT_SCALE = "scale"  # in these files not the scale of the depth
HEADER_BYTES = 256  # of a .npy; its type is in the first hundred
PICKLES = (".npy", ".pkl", ".pickle")


def _find(folder: Path, options: FrameOptions) -> list[FoundFrame]:
    """List the `.npz` files of `folder` that hold a frame.

    Damaged files, and pickles without a `.npz` of the same name, are listed to be reported.
    """
    files = sorted(path for path in folder.glob("[!.]*.npz") if path.is_file())
    names = {path: _arrays_in(path) for path in files}
    frames = [path for path in files if _make_frame(names[path])]
    if not frames:
        return []
    listed = [path for path in files if path in frames or names[path] is None]
    twins = {path.stem for path in listed}
    pickles = [path for path in _pickles(folder, options) if path.stem not in twins]
    lacking = [path for path in frames if not _has_camera(names[path] or ())]
    cameras = camera_files(folder, lacking)
    return [_found(path, options, cameras.get(path)) for path in (*listed, *pickles)]


def camera_files(folder: Path, frames: list[Path]) -> dict[Path, Path | None]:
    """Return the camera file of each of `frames` in `folder`, its own or that of all, if any."""
    shared = shared_camera_file(folder) if frames else None
    return {path: own_camera_file(folder, path.stem) or shared for path in frames}


def find_pickled(folder: Path, options: FrameOptions) -> list[FoundFrame]:
    """List the files of `folder` that hold a pickle; reading one raises unless it is trusted.

    Damaged `.npz` files are listed too: no other layout reports them.
    """
    damaged = [path for path in sorted(folder.glob("[!.]*.npz")) if _arrays_in(path) is None]
    return [_found(path, options) for path in (*damaged, *_pickles(folder, options))]


def _found(path: Path, options: FrameOptions, camera: Path | None = None) -> FoundFrame:
    if path.suffix != ".npz":
        read = functools.partial(_read_pickled, path, options)
        return FoundFrame(path.stem, read, (path,), PICKLED_NAME)
    return FoundFrame(
        path.stem, functools.partial(_read, path, options, camera), (path, camera), NAME
    )


def _pickles(folder: Path, options: FrameOptions) -> list[Path]:
    """List the pickles; a `.pkl`, which may hold anything, counts only if it is trusted."""
    suffixes = PICKLES if options.trust_pickles else PICKLES[:1]
    files = sorted(path for path in folder.iterdir() if path.suffix in suffixes)
    return [path for path in files if path.suffix != ".npy" or is_pickled(path)]


def is_pickled(path: Path) -> bool:
    """Return whether a `.npy` holds Python objects instead of numbers; nothing is unpickled."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        header = stream.read(HEADER_BYTES)
    return re.search(rb"'descr': *'\|?O[48]?'", header) is not None


def frame_of_arrays(
    path: Path,
    arrays: dict[str, NDArray[Any]],
    options: FrameOptions,
    camera_file: Path | None = None,
) -> Frame:
    """Return the frame of the named arrays in `path`; `camera_file` counts if they have no camera.

    Raises:
        FormatError: no depth, no camera, or arrays of a wrong shape or type.
    """
    if "depth" not in arrays:
        kind = "a point cloud" if set(CLOUD_KEYS) & set(arrays) else f"{sorted(arrays)}"
        raise FormatError(path, f"holds {kind} without a depth image", "add the array `depth`")
    depth = arrays[next((key for key in arrays if ALIGNED_DEPTH.fullmatch(key)), "depth")]
    images = (key for key in COLOR_KEYS if key in arrays)
    key = next((key for key in images if key in COLOR_KEYS[:2] or arrays[key].ndim > 2), None)
    color = None if key is None else functools.partial(_color, path, key, arrays[key])
    facts = _facts(arrays)
    camera = options.camera or _camera(path, facts, camera_file)
    stated = units_of(path, facts) if options.needs_units else None
    if stated is None and camera_file is not None and options.needs_units:
        stated = read_units(camera_file, path.stem)
    return make_frame((path, color), (path, depth), camera, options.depth_units(stated))


def _read(path: Path, options: FrameOptions, camera_file: Path | None) -> Frame:
    return frame_of_arrays(path, read_npz(path), options, camera_file)


def _read_pickled(path: Path, options: FrameOptions) -> Frame:
    if not options.trust_pickles:
        raise FormatError(
            path,
            "holds a pickled dictionary, which can run any code when it is read",
            f"if you trust it, `symgrasp convert-frames {path} --out DIR --trust-pickle` "
            "takes the arrays out",
        )
    content = read_plain_pickle(path)
    if not isinstance(content, dict):
        found = f"holds a {type(content).__name__}"
        raise FormatError(path, found, "a dictionary of arrays is expected")
    arrays = {key: value for key, value in content.items() if isinstance(value, np.ndarray)}
    return frame_of_arrays(path, arrays, options)


def _arrays_in(path: Path) -> set[str] | None:
    """Return the names of the arrays in an `.npz`, without reading these; None if damaged."""
    try:
        with zipfile.ZipFile(existing(path)) as archive:
            return {name.removesuffix(".npy") for name in archive.namelist()}
    except (*DAMAGED, SymgraspError):
        return None


def _make_frame(names: set[str] | None) -> bool:
    """Return whether arrays of these names are a frame.

    An `.npz` of depth alone belongs to a colour image of its name.
    """
    names = names or set()
    is_frame = _has_camera(names) or bool(names & {*COLOR_KEYS})
    return ("depth" in names and is_frame) or CLOUD_KEYS[0] in names


def _has_camera(names: Container[str]) -> bool:
    """Return whether arrays of these names hold a camera."""
    return any(key in names for key in (*CAMERA_KEYS, *SYNONYMS["fx"]))


def _color(path: Path, key: str, stored: NDArray[Any]) -> NDArray[np.uint8]:
    expected = "(height, width, 3) of uint8, or of floats from 0 to 1, is expected"
    if 0 in stored.shape:
        raise FormatError(path, f"`{key}` is empty", expected)
    if stored.dtype.kind == "f" and bool(((stored >= 0) & (stored <= 1)).all()):
        stored = np.rint(stored * 255.0).astype(np.uint8)
    if stored.ndim != 3 or stored.shape[2] not in (3, 4) or stored.dtype != np.uint8:
        found = f"`{key}` is an array {stored.shape} of {stored.dtype}"
        raise FormatError(path, found, expected)
    color = stored[:, :, :3]
    return np.ascontiguousarray(color[:, :, ::-1] if key == COLOR_KEYS[0] else color)


def _facts(arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the small arrays as a camera file would hold them: camera, lens, unit of the depth."""
    small = {key: each for key, each in arrays.items() if each.size <= MOST_NUMBERS}
    return {key: each.tolist() for key, each in small.items() if key != OBJECT_SCALE}


def _camera(path: Path, facts: dict[str, Any], camera_file: Path | None) -> CameraFile:
    if _has_camera(facts):
        return camera_from_mapping(path, facts)
    if camera_file is not None:
        return read_camera_file(camera_file, path.stem)
    expected = f"add one of {', '.join(CAMERA_KEYS)}, or {where_a_camera_may_be(path)}"
    raise FormatError(path, "has no camera matrix", expected)


LAYOUT = Layout(NAME, _find)
PICKLED = Layout(PICKLED_NAME, find_pickled)
