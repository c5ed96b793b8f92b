"""The workspace given by a user: a mask picture, or six numbers of a box."""

import re
from pathlib import Path

import numpy as np

from pipelines.array_types import Mask
from pipelines.errors import ValueRangeError
from pipelines.frames.masks import at_size
from pipelines.storage.files import is_file
from pipelines.storage.images import read_image

FORMS = "x0,y0,z0,x1,y1,z1 in metres, or the path of an existing mask picture"


def parse_workspace(text: str | None) -> tuple[tuple[float, ...], Path | None]:
    """Return the box or the mask file of `--workspace`; () and None mean no limit.

    Raises:
        ValueRangeError: neither six numbers nor a file.
        FormatError: the file is no image, which would be the fault of every frame.
    """
    if text is None:
        return (), None
    path = Path(text)
    if is_file(path):
        read_image(path)
        return (), path
    if box := box_of_text(text):
        return box, None
    raise ValueRangeError("--workspace", text, FORMS)


def box_of_text(text: str) -> tuple[float, ...]:
    """Return the six numbers of `text`; () if it is no six numbers."""
    try:
        box = tuple(float(part) for part in re.split(r"[,\s]+", text.strip()))
    except ValueError:
        return ()
    return box if len(box) == 6 else ()


def read_workspace_mask(path: Path, shape: tuple[int, ...]) -> Mask:
    """Return the mask (H, W) of pixels of a picture that are not black; `shape` is the depth's.

    Raises:
        SymgraspError: no such picture, or a picture whose sides have another ratio.
    """
    picture = read_image(path)
    inside = (picture if picture.ndim == 2 else picture[..., :3].max(axis=-1)) > 0
    return np.asarray(at_size(path, inside, shape))
