"""RGB-D frames that come with the package, for first trials."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Singles
from pipelines.errors import UnknownNameError
from pipelines.frames.frames import find_frames
from pipelines.geometry.camera import Intrinsics
from pipelines.inference.models import WEIGHTS


class FrameArrays(NamedTuple):
    """A frame as `GraspDetector` takes it.

    Attributes:
        color: (H, W, 3) RGB.
        depth: (H, W) metres, 0 = missing.
        intrinsics: of the depth image.
    """

    color: NDArray[np.uint8]
    depth: Singles
    intrinsics: Intrinsics


def bundled_frame(name: str = "table_1") -> FrameArrays:
    """Return one of the frames `table_1` to `table_4`.

    Raises:
        UnknownNameError: there is no such frame.
    """
    sources = {source.name: source for source in find_frames(WEIGHTS / "frames")}
    if name not in sources:
        raise UnknownNameError("bundled frame", name, sources)
    frame = sources[name].read()
    return FrameArrays(frame.color, frame.depth, frame.intrinsics)
