"""BOP scenes: a camera an image in `scene_camera.json`; several sensors by a suffix of all names.

`rgb_photoneo/`, `depth_photoneo/` and `scene_camera_photoneo.json` are one sensor's, as BOP's
industrial data sets have them; its frames lie below the sensor's name.
"""

import functools
from pathlib import Path

from pipelines.frames.layouts.layout import Layout, frame_name
from pipelines.frames.layouts.paired import read_frame
from pipelines.frames.rgbd import FrameSource
from pipelines.frames.rgbd_folder import FrameOptions, sister_pairs

NAME = "BOP scene"
INDEX = "scene_camera"


def _find(folder: Path, prefix: str, options: FrameOptions) -> list[FrameSource]:
    """List the frames of each sensor that has colour (or grey) and depth."""
    sources = []
    for camera in sorted(folder.glob(f"{INDEX}*.json")):
        suffix = camera.stem.removeprefix(INDEX)
        for pair in sister_pairs(folder, suffix):
            name = frame_name(folder, prefix, f"{suffix.strip('_')}/{pair.stem}")
            files = tuple(path for path in (pair.color, pair.depth, camera) if path is not None)
            read = functools.partial(read_frame, name, pair, camera, options)
            sources.append(FrameSource(name, read, files, NAME))
    return sources


LAYOUT = Layout(NAME, _find)
