"""BOP scenes: a camera per image in `scene_camera.json`; several sensors by a suffix of all names.

SIXD, BOP's first form, has them in `info.yml`; LINEMOD is often passed on so.
`rgb_photoneo/`, `depth_photoneo/` and `scene_camera_photoneo.json` belong to one sensor, as in
BOP's industrial data sets; the names of its frames begin with the sensor's name.
"""

import functools
from collections.abc import Iterator
from pathlib import Path

from pipelines.frames.cameras.camera_files import SIXD_INDEX
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.layouts.paired import holds_text, read_paired
from pipelines.frames.pairing.image_pairs import sister_pairs

INDEX = "scene_camera"


def _find(folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
    """Yield the frames of each sensor that has colour (or grey) and depth."""
    old = [path for path in (folder / SIXD_INDEX,) if holds_text(path, "cam_K")]
    for camera in sorted(folder.glob(f"{INDEX}*.json")) or old:
        suffix = "" if camera.name == SIXD_INDEX else camera.stem.removeprefix(INDEX)
        for pair in sister_pairs(folder, suffix):
            read = functools.partial(read_paired, pair, camera, options)
            stem = f"{suffix.strip('_')}/{pair.stem}"
            files = (pair.color, pair.depth, camera)
            yield FoundFrame(stem, read, files, is_whole=pair.is_whole)


LAYOUT = Layout("BOP scene", _find)
