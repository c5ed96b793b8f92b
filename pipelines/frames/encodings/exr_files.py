"""Depth in OpenEXR files: half and float, one channel or several equal channels."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.contents import MAX_PIXELS, UNFIT
from pipelines.errors import FormatError
from pipelines.storage.files import existing

MAX_CHANNELS = 16  # of an image, which may have colours and normals in addition to depth
# All threads have one stdout: if two redirected it at once, it could stay redirected.
_redirecting = Lock()


def read_exr(path: Path) -> NDArray[Any]:
    """Return the depth (H, W) of an OpenEXR file, or (H, W, channels) where channels differ.

    Depth is the channel that `_named_depth` finds; else the channel that all others repeat, or the
    only one that is not empty. Alpha does not count.

    Raises:
        FormatError: the file is damaged or too large, or a channel has another size than the image.
    """
    import OpenEXR  # noqa: PLC0415 - few need it

    expected = "a whole OpenEXR file of one part is expected"
    try:
        with OpenEXR.File(str(existing(path)), separate_channels=True, header_only=True) as file:
            header = file.header()
            low, high = (np.asarray(side, np.int64) for side in header["dataWindow"])
            count = len(header["channels"])
        width, height = (int(side) for side in high - low + 1)
        if min(width, height) < 1 or width * height > MAX_PIXELS:
            found = f"is an image of {width}x{height}"
            raise FormatError(path, found, f"at most {MAX_PIXELS} pixels are read")
        if count > MAX_CHANNELS:
            raise FormatError(path, f"has {count} channels", f"at most {MAX_CHANNELS} are read")
        # For damaged pixels OpenEXR prints a warning and returns no part; stdout is for reports.
        with _printing_to_stderr(), OpenEXR.File(str(path), separate_channels=True) as file:
            if not file.parts:
                raise ValueError("its pixels are damaged or cut off")
            channels = {name: np.array(each.pixels) for name, each in file.channels().items()}
    except (RuntimeError, *UNFIT) as error:
        raise FormatError(path, f"this is no readable .exr ({error})", expected) from error
    channels = {name: each for name, each in channels.items() if _word(name) != "a"}
    if not channels or any(each.shape != (height, width) for each in channels.values()):
        expected = "one channel of all pixels is expected"
        raise FormatError(path, f"has the channels {sorted(channels)}", expected)
    return _depth_of(channels)


@contextmanager
def _printing_to_stderr() -> Iterator[None]:
    with _redirecting, redirect_stdout(sys.stderr):
        yield


def _depth_of(channels: dict[str, NDArray[Any]]) -> NDArray[Any]:
    chosen = [channels[name] for name in _named_depth(list(channels)) or channels]
    filled = [each for each in chosen if each.any()]
    first = next(iter(filled or chosen))
    if all(np.array_equal(each, first, equal_nan=True) for each in filled):
        return first
    return np.stack(filled, axis=-1)


def _named_depth(names: list[str]) -> list[str]:
    """Return the channels that are depth by name: of a layer `depth`, else Z, else Y alone.

    Z next to X is part of a normal or a position; Y next to others may be a colour's luminance.
    """
    lower = {name.lower() for name in names}
    layer = [name for name in names if "depth" in name.lower().split(".")]
    z = [
        name
        for name in layer or names
        if _word(name) == "z" and f"{name[:-1]}x".lower() not in lower
    ]
    bare = [name for name in names if "." not in name]
    return z or layer or [name for name in bare if _word(name) == "y" and len(bare) == 1]


def _word(name: str) -> str:
    return name.rpartition(".")[2].lower()
