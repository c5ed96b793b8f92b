"""The user's own instance masks: one PNG of instance ids per frame, 0 = background.

Labelling tools store ids as one channel, as three equal channels, or as indices of a palette;
simulators give each instance a colour.
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
MOST_COLORS = 1000  # of instances and of blurred outlines; a photograph has more
COLOR_WEIGHTS = np.array([1 << 16, 1 << 8, 1], np.int32)  # of red, green and blue in an id


def read_masks(
    folder: Path, frame_name: str, shape: tuple[int, ...], shared: Container[str] = ()
) -> NDArray[np.int32]:
    """Read the instance ids (H, W) of a frame, 0 = background; `shape` is the depth's.

    Searches for `NAME_label.png`, `NAME.png`, `NAME_mask.png`, first with the frame's whole
    relative name, then with its last part only, unless this is among `shared`, the last parts that
    several frames share.

    Raises:
        SymgraspError: no such file.
        FormatError: the file is no image, is a photograph, or has sides of another ratio.
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
        stored = _places_in_palette(path) if _has_palette(path) else _ids(path, stored)
    return at_size(path, stored, shape).astype(np.int32)


def at_size(path: Path, drawn: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Return the picture `drawn` (H, W) in `path` at the `shape` of the depth, by nearest pixels.

    It may be drawn on colour of another size, which `fit_color` resamples.

    Raises:
        FormatError: the sides have another ratio.
    """
    height, width = drawn.shape
    if height * shape[1] != width * shape[0]:
        expected = f"the frame's depth has {shape[1]} x {shape[0]}"
        raise FormatError(path, f"has {width} x {height} pixels", expected)
    rows, columns = (
        (2 * np.arange(new) + 1) * old // (2 * new)
        for new, old in zip(shape, drawn.shape, strict=True)
    )
    return drawn[np.ix_(rows, columns)]


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


def _ids(path: Path, stored: NDArray[Any]) -> NDArray[Any]:
    """Return the channel (H, W) that all of `stored` (H, W, 3) repeat, else a number per colour."""
    if (stored == stored[:, :, :1]).all():
        return stored[:, :, 0]
    colors = stored.astype(np.int32) @ COLOR_WEIGHTS
    if stored.dtype != np.uint8 or len(np.unique(colors)) > MOST_COLORS:
        found = f"has channels of {stored.dtype} that differ, as a photograph has"
        raise FormatError(path, found, "one number or one colour for each instance is expected")
    return np.asarray(colors)
