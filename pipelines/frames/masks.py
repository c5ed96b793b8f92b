"""The user's own instance masks: one PNG of instance ids a frame, 0 = background.

Labelling tools store ids as one channel, as three equal ones, or as places in a palette.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError, SymgraspError
from pipelines.storage.images import read_image

PNG, KIND_AT, PALETTE = b"\x89PNG", 25, b"\x03"  # where one says of what kind it is, and the kind
VOID = 255  # PASCAL VOC's place of outlines, which are nothing's
MASK_ENDINGS = ("_label.png", ".png", "_mask.png")


def read_masks(folder: Path, frame_name: str) -> NDArray[np.int32]:
    """Read the instance ids (H, W) of a frame, 0 = background.

    Looks for `NAME_label.png`, `NAME.png`, `NAME_mask.png`, first with the frame's whole relative
    name, then with its last part only.

    Raises:
        SymgraspError: no such file.
        FormatError: not an image, or of channels that differ.
    """
    names = dict.fromkeys((frame_name, frame_name.rsplit("/", 1)[-1]))
    candidates = [folder / f"{name}{ending}" for name in names for ending in MASK_ENDINGS]
    path = next((path for path in candidates if path.is_file()), None)
    if path is None:
        looked_for = ", ".join(f"{frame_name}{ending}" for ending in MASK_ENDINGS)
        raise SymgraspError(f"{folder} has no mask for frame {frame_name}; give {looked_for}")
    stored = read_image(path)
    if stored.ndim == 3:
        stored = _places_in_palette(path) if _has_palette(path) else _grey(path, stored)
    return stored.astype(np.int32)


def _has_palette(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(KIND_AT + 1)
    return head.startswith(PNG) and head[KIND_AT:] == PALETTE


def _places_in_palette(path: Path) -> NDArray[np.uint8]:
    """Return what a PNG with a palette stores (H, W): the ids; the colours are for the eye."""
    from PIL import Image  # noqa: PLC0415 - few need it

    with Image.open(path) as picture:
        places = np.array(picture, dtype=np.uint8)
    places[places == VOID] = 0
    return places


def _grey(path: Path, stored: NDArray[Any]) -> NDArray[Any]:
    """Return the one channel (H, W) that all of `stored` (H, W, 3) repeat."""
    if (stored != stored[:, :, :1]).any():
        expected = "instance ids in one channel, or in the palette's places, are expected"
        raise FormatError(path, f"has {stored.shape[2]} channels that differ", expected)
    return stored[:, :, 0]
