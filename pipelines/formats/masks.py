"""The user's own instance masks: one PNG of instance ids a frame, 0 = background."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError, SymgraspError
from pipelines.formats.files import read_image

MASK_ENDINGS = ("_label.png", ".png", "_mask.png")


def read_masks(folder: Path, frame_name: str) -> NDArray[np.int32]:
    """Read the instance ids (H, W) of a frame, 0 = background.

    Looks for `NAME_label.png`, `NAME.png`, `NAME_mask.png`, first with the frame's whole relative
    name, then with its last part only.

    Raises:
        SymgraspError: no such file.
        FormatError: not an image of one channel.
    """
    names = dict.fromkeys((frame_name, frame_name.rsplit("/", 1)[-1]))
    candidates = [folder / f"{name}{ending}" for name in names for ending in MASK_ENDINGS]
    path = next((path for path in candidates if path.is_file()), None)
    if path is None:
        looked_for = ", ".join(f"{frame_name}{ending}" for ending in MASK_ENDINGS)
        raise SymgraspError(f"{folder} has no mask for frame {frame_name}; give {looked_for}")
    stored = read_image(path)
    if stored.ndim != 2:
        raise FormatError(
            path, f"has {stored.shape[2]} channels", "instance ids in one channel are expected"
        )
    return stored.astype(np.int32)
