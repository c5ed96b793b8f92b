"""TUM RGB-D: colour and depth images of other times, paired by time; metres = value / 5000."""

import functools
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TypeVar

from pipelines.errors import FormatError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.cameras.camera_search import find_camera_file
from pipelines.frames.cameras.lens import BROWN, NO_DISTORTION, Distortion
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.layouts.layout import FoundFrame, Layout
from pipelines.frames.layouts.paired import read_with_camera
from pipelines.storage.files import is_file, read_text, real_path

UNITS_PER_METRE = 5000.0
LARGEST_GAP = 0.02  # seconds between a colour and a depth image of one frame
# The published calibrations of the colour images, with which the depth is registered; a sequence's
# folder is named after its camera.
CALIBRATIONS = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3),
    "freiburg2": (520.9, 521.0, 325.1, 249.7),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
# Images of freiburg3 are already undistorted.
DISTORTIONS = {
    "freiburg1": Distortion(BROWN, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "freiburg2": Distortion(BROWN, (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
}
Stamped = list[tuple[float, Path]]
Timed = TypeVar("Timed")  # an image, such as its path; can be put in order


def _find(folder: Path, options: FrameOptions) -> Iterator[FoundFrame]:
    """Yield the frames of a sequence, by the time of their colour image.

    Raises:
        FormatError: an index whose lines are not `time path`.
    """
    index = folder / "associations.txt"
    if index.is_file() and (folder / "depth").is_dir():
        pairs = _associated(folder, index)
    elif (folder / "rgb.txt").is_file() and (folder / "depth.txt").is_file():
        pairs = associate(*(_listed(folder, folder / f"{kind}.txt") for kind in ("rgb", "depth")))
    else:
        return
    camera_file = find_camera_file(folder, "rgb")
    if options.camera is None and camera_file is None:
        options = replace(options, camera=_published(folder))
    for color, depth in pairs:
        read = functools.partial(
            read_with_camera, color, depth, camera_file, options, UNITS_PER_METRE
        )
        present = (path for path in (color, depth) if is_file(path))
        yield FoundFrame(color.stem, read, (*present, camera_file))


def associate(
    colors: list[tuple[float, Timed]], depths: list[tuple[float, Timed]]
) -> list[tuple[Timed, Timed]]:
    """Pair images whose times are nearest, each used once and at most 0.02 s apart.

    Images of one time, as of a camera without a clock, are paired in their order.
    """
    left = [_by_time(images) for images in (colors, depths)]
    pairs: list[tuple[float, Timed, Timed]] = []
    for _gap, *times in sorted(_near(*(sorted(each) for each in left))):
        color_images, depth_images = (each[time] for each, time in zip(left, times, strict=True))
        count = min(len(color_images), len(depth_images))
        both = zip(color_images[:count], depth_images[:count], strict=True)
        pairs += [(times[0], color, depth) for color, depth in both]
        del color_images[:count], depth_images[:count]
    return [(color, depth) for _time, color, depth in sorted(pairs)]


def _by_time(images: list[tuple[float, Timed]]) -> dict[float, list[Timed]]:
    """Return the images of each time, in order."""
    found: dict[float, list[Timed]] = defaultdict(list)
    for time, image in sorted(images):
        found[time].append(image)
    return found


def _near(colors: list[float], depths: list[float]) -> Iterator[tuple[float, float, float]]:
    """Yield the gap and both times of all pairs of times that are near; both lists ascend."""
    first = 0
    for color in colors:
        while first < len(depths) and depths[first] < color - LARGEST_GAP:
            first += 1
        for depth in islice(depths, first, None):
            if depth > color + LARGEST_GAP:
                break
            yield abs(depth - color), color, depth


def _listed(folder: Path, index: Path) -> Stamped:
    return [(_time(index, line[0]), folder / line[1]) for line in _lines(index, 2)]


def _associated(folder: Path, index: Path) -> list[tuple[Path, Path]]:
    """Read `time path time path`; the path in `depth/` is the depth image."""
    pairs = []
    for _t0, one, _t1, other in _lines(index, 4):
        color, depth = (other, one) if one.startswith("depth/") else (one, other)
        pairs.append((folder / color, folder / depth))
    return pairs


def _lines(index: Path, fields: int) -> list[list[str]]:
    text = read_text(index).replace("\0", "?")
    lines = [line.split() for line in text.splitlines() if not line.lstrip().startswith("#")]
    lines = [line for line in lines if line]
    wrong = next((line for line in lines if len(line) != fields), None)
    if wrong is not None:
        expected = "`time path`" if fields == 2 else "`time path time path`"
        raise FormatError(index, f"has the line {' '.join(wrong)!r}", f"{expected} is expected")
    return lines


def _time(index: Path, text: str) -> float:
    try:
        time = float(text)
    except ValueError:
        time = math.nan
    if not math.isfinite(time):
        raise FormatError(index, f"has the time {text!r}", "seconds are expected")
    return time


def _published(folder: Path) -> CameraFile | None:
    # The nearest folder's name counts: the folder of one camera may be below that of another.
    names = re.findall(r"freiburg[123]", str(real_path(folder)))
    if not names:
        return None
    name = names[-1]
    lens = DISTORTIONS.get(name, NO_DISTORTION)
    origin = f"calibration of {name}"
    return CameraFile(*CALIBRATIONS[name], 640, 480, origin=origin, distortion=lens)


LAYOUT = Layout("TUM RGB-D", _find)
