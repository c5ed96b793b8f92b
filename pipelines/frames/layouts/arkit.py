"""ARKitScenes: colour, depth in millimetres, and a camera for each image, in folders of one size.

An image and its camera have one name, `VIDEO_SECONDS`, whose milliseconds may be rounded otherwise.
"""

import functools
from collections.abc import Iterator
from pathlib import Path

from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.layouts.paired import read_paired
from pipelines.frames.pairing.image_pairs import pairs_in

# Of laser scans, 1920x1440, which few images have; of the phone itself, 256x192.
FOLDERS = (("wide", "highres_depth"), ("lowres_wide", "lowres_depth"))
ROUNDING = (0, -1, 1)  # milliseconds


def _find(folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
    """Yield the frames of the first size that has any; each size has other images."""
    for color, depth in FOLDERS:
        cameras = folder / f"{color}_intrinsics"
        if not (cameras.is_dir() and (folder / color).is_dir() and (folder / depth).is_dir()):
            continue
        whole = [pair for pair in pairs_in(folder / color, folder / depth) if pair.is_whole]
        for pair in whole:
            camera = _camera(cameras, pair.stem)
            read = functools.partial(read_paired, pair, camera, options)
            yield FoundFrame(pair.stem, read, (pair.color, pair.depth, camera))
        if whole:
            return


def _camera(cameras: Path, stem: str) -> Path | None:
    """Return the camera of the image `stem`, None if it has none."""
    video, _, time = stem.rpartition("_")
    try:
        times = [f"{float(time) + each / 1000:.3f}" for each in ROUNDING]
    except ValueError:
        return None
    named = (cameras / f"{video}_{each}.pincam" for each in times)
    return next((path for path in named if path.is_file()), None)


LAYOUT = Layout("ARKitScenes", _find)
