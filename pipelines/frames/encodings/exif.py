"""The EXIF orientation of a picture, by which phones mark that it is to be shown turned.

Pixels are read as stored, and so is the depth, which has no such mark.
"""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

MARKED = (".jpg", ".jpeg", ".png")  # OpenCV turns TIFF by itself
MARKS = (b"Exif", b"eXIf")
HEAD = 2**16  # bytes; the mark is at the beginning
ORIENTATION, UPRIGHT = 0x0112, 1
TURNS = {6: -1, 8: 1}  # quarter turns to the left; the others keep the sides or mirror
FAULTS = (OSError, ValueError, TypeError, LookupError, SyntaxError, struct.error)  # of damaged EXIF


def turned_like_depth(
    path: Path, color: NDArray[np.uint8], height: int, width: int
) -> tuple[NDArray[np.uint8], tuple[str, ...]]:
    """Return `color` (H, W, 3) as the depth of the given size shows it, and a remark if marked.

    The picture is turned if only then its sides are as those of the depth.
    """
    orientation = _orientation(path)
    if orientation == UPRIGHT:
        return color, ()
    rows, columns = color.shape[:2]
    is_alike, is_across = rows * width == columns * height, columns * width == rows * height
    if orientation in TURNS and is_across and not is_alike:
        turned = np.ascontiguousarray(np.rot90(color, TURNS[orientation]))
        return turned, (f"colour is turned by its EXIF orientation {orientation}, as the depth is",)
    note = f"the EXIF orientation {orientation} of the colour is not applied: depth has none"
    return color, (note,)


def _orientation(path: Path) -> int:
    """Return the orientation that the picture in `path` is marked with; 1 without a whole mark."""
    if path.suffix.lower() not in MARKED:
        return UPRIGHT
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD)
        if not any(mark in head for mark in MARKS):
            return UPRIGHT
        from PIL import Image  # noqa: PLC0415 - few pictures are marked

        with Image.open(path) as picture:
            marked = int(picture.getexif().get(ORIENTATION, UPRIGHT))
    except FAULTS:
        return UPRIGHT
    return marked if 1 <= marked <= 8 else UPRIGHT
