"""nerfstudio: `transforms.json` names the colour and depth image of each frame; millimetres.

Both show one view; the depth may be smaller, as of phones.

instant-ngp names the depth `depth_path`, and may leave out the suffix of the colour, `.png`.
"""

import functools
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import camera_from_mapping, units_of
from pipelines.frames.cameras.stated_sizes import first_stated
from pipelines.frames.depth.stated_units import DEPTH_KEYS
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.rgbd import Frame, read_pair
from pipelines.storage.files import is_file, read_json

INDEX = "transforms.json"
DEPTH_PATHS = ("depth_file_path", "depth_path")
MODELS = ("OPENCV", "OPENCV_FISHEYE", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
CAMERA_KEYS = ("fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "k3", "k4", "p1", "p2")
KEYS = (*CAMERA_KEYS, *DEPTH_KEYS)  # `scale` is that of the scene


def _find(folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
    """Yield the frames that have a depth image, in the order of the file.

    If two colour images have one name, the names of all frames have their folder.

    Raises:
        FormatError: `transforms.json` is damaged.
    """
    index = folder / INDEX
    if not index.is_file():
        return
    content = read_json(index)
    if not isinstance(content, dict) or not isinstance(content.get("frames"), list):
        return
    frames = [frame for frame in content["frames"] if _has_depth(frame)]
    stems = [Path(frame["file_path"]).stem for frame in frames]
    is_unique = len(set(stems)) == len(stems)
    for frame, stem in zip(frames, stems, strict=True):
        color, depth = (folder / path for path in _paths(frame) if path)
        color = color if color.suffix else Path(f"{color}.png")
        name = stem if is_unique else str(Path(frame["file_path"]).parent / stem)
        camera = {key: frame.get(key, content.get(key)) for key in KEYS}
        camera["camera_model"] = content.get("camera_model", "OPENCV")
        read = functools.partial(_read, color, depth, index, camera, options)
        files = (path for path in (color, depth) if is_file(path))
        yield FoundFrame(name, read, (*files, index))


def _paths(frame: dict[str, Any]) -> tuple[Any, Any]:
    """Return the paths of the colour and the depth image as stated."""
    return frame.get("file_path"), first_stated(frame, DEPTH_PATHS)


def _has_depth(frame: Any) -> bool:  # noqa: ANN401 - JSON of any form
    if not isinstance(frame, dict):
        return False
    return all(isinstance(path, str) and path and "\0" not in path for path in _paths(frame))


def _read(
    color: Path,
    depth: Path,
    index: Path,
    camera: Mapping[str, Any],
    options: FrameOptions,
) -> Frame:
    if options.camera is None and camera["camera_model"] not in MODELS:
        found = f"the camera model is {camera['camera_model']!r}"
        raise FormatError(index, found, f"undistort the images; {', '.join(MODELS)} are read")
    stated = options.camera or replace(
        camera_from_mapping(index, dict(camera)), is_of_any_size=True
    )
    units = units_of(index, camera) if options.needs_units else None
    return read_pair(color, depth, stated, options.depth_units(units))


LAYOUT = Layout("nerfstudio", _find)
