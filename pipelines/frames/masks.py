"""The user's own instance masks: one PNG of instance ids per frame, 0 = background.

Labelling tools store ids as one channel, as three equal channels, or as indices of a palette.
"""

from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.frame_names import last_part
from pipelines.storage.images import read_image

PNG, KIND_AT, PALETTE = b"\x89PNG", 25, b"\x03"  # place of the colour type in a file, and the type
VOID = 255  # PASCAL VOC's index of outlines, which belong to no instance
MASK_ENDINGS = ("_label.png", ".png", "_mask.png")


def read_masks(folder: Path, frame_name: str, shared: Container[str] = ()) -> NDArray[np.int32]:
    """Read the instance ids (H, W) of a frame, 0 = background.

    Searches for `NAME_label.png`, `NAME.png`, `NAME_mask.png`, first with the frame's whole
    relative name, then with its last part only, unless this is among `shared`, the last parts that
    several frames share.

    Raises:
        SymgraspError: no such file.
        FormatError: the file is no image, or has channels that differ.
    """
    last = last_part(frame_name)
    names = dict.fromkeys((frame_name, frame_name if last in shared else last))
    candidates = [folder / f"{name}{ending}" for name in names for ending in MASK_ENDINGS]
    path = next((path for path in candidates if path.is_file()), None)
    if path is None:
        names_tried = ", ".join(f"{frame_name}{ending}" for ending in MASK_ENDINGS)
        why = f", as several frames end in {last}" if last in shared else ""
        raise SymgraspError(f"{folder} has no mask for frame {frame_name}; give {names_tried}{why}")
    stored = read_image(path)
    if stored.ndim == 3:
        stored = _places_in_palette(path) if _has_palette(path) else _grey(path, stored)
    return stored.astype(np.int32)


def _has_palette(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(KIND_AT + 1)
    return head.startswith(PNG) and head[KIND_AT:] == PALETTE


def _places_in_palette(path: Path) -> NDArray[np.uint8]:
    """Return the ids (H, W) of a PNG with a palette: its indices; colours are for display only."""
    from PIL import Image  # noqa: PLC0415 - few masks need it

    with Image.open(path) as picture:
        places = np.array(picture, dtype=np.uint8)
    places[places == VOID] = 0
    return places


def _grey(path: Path, stored: NDArray[Any]) -> NDArray[Any]:
    """Return the channel (H, W) that all channels of `stored` (H, W, 3) repeat."""
    if (stored != stored[:, :, :1]).any():
        expected = "instance ids in one channel, or as indices of a palette, are expected"
        raise FormatError(path, f"has {stored.shape[2]} channels that differ", expected)
    return stored[:, :, 0]
