"""A frame posted as one JSON object: images as PNG or raw arrays in base64, and the camera."""

from base64 import b64decode
from binascii import Error as NoBase64
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from pipelines.contents import parsed_json
from pipelines.errors import ValueRangeError, counted

KEYS = ("color", "depth", "intrinsics", "depth_units_per_metre", "workspace", "masks", "name")
NAME_LIMIT = 1000  # characters
COLOR_FORMATS, DEPTH_FORMATS = ("PNG", "JPEG"), ("PNG",)
RAW_TYPES = {"color": ("uint8",), "depth": ("uint16", "float32"), "masks": ("uint8", "int32")}
MODES = {"color": "RGB", "depth": "I;16", "masks": "I"}


@dataclass(frozen=True)
class PostedFrame:
    """The arguments of `symgrasp.GraspDetector` for one frame.

    Attributes:
        color: (H, W, 3) RGB.
        depth: (H, W) whole numbers or metres.
        options: intrinsics and other posted options, by the detector's names.
        name: name of the frame, which identifies its answer.
    """

    color: NDArray[np.uint8]
    depth: NDArray[Any]
    options: dict[str, Any]
    name: str = ""


def posted_frame(body: bytes, max_pixels: int) -> PostedFrame:
    """Return the frame in the body of a POST request.

    Raises:
        ValueRangeError: `body` is no JSON object of a frame; the message states the fault.
    """
    try:
        content = parsed_json(body)
    except (ValueError, RecursionError) as error:
        raise ValueRangeError("body", f"no JSON ({error})", "an object with a frame") from None
    if not isinstance(content, dict):
        raise ValueRangeError("body", f"a {type(content).__name__}", "an object with a frame")
    if unknown := sorted(set(content) - set(KEYS)):
        raise ValueRangeError("key", repr(unknown[0])[:80], f"one of {', '.join(KEYS)}")
    if missing := [key for key in KEYS[:3] if content.get(key) is None]:
        raise ValueRangeError("body", f"without {missing[0]}", f"with {', '.join(KEYS[:3])}")
    color, depth = (_image(key, content[key], max_pixels) for key in ("color", "depth"))
    options = {key: content[key] for key in KEYS[2:5] if content.get(key) is not None}
    if content.get("masks") is not None:
        options["masks"] = _image("masks", content["masks"], max_pixels)
    name = "" if content.get("name") is None else content["name"]
    if not isinstance(name, str) or len(name) > NAME_LIMIT:
        expected = f"the frame's name, at most {NAME_LIMIT} characters"
        raise ValueRangeError("name", "no short text", expected)
    return PostedFrame(color, depth, options, name)


def _image(key: str, content: object, max_pixels: int) -> NDArray[Any]:
    """Return an image, posted as a file in base64 or as `{"shape", "dtype", "data"}`."""
    if isinstance(content, dict):
        return _raw_array(key, content, max_pixels)
    formats = COLOR_FORMATS if key == "color" else DEPTH_FORMATS
    expected = f"{' or '.join(formats)} in base64, or an object of shape, dtype and data"
    try:
        with Image.open(BytesIO(_bytes(key, content, expected)), formats=formats) as image:
            _check_pixels(key, image.width * image.height, max_pixels)
            is_depth, deep = key == "depth", image.mode.startswith("I")
            if key != "masks" and is_depth != deep:
                bits = "a PNG of 16 bits" if is_depth else "of 8 bits per channel"
                raise ValueRangeError(key, f"of mode {image.mode}", bits)
            array = np.asarray(image.convert(MODES[key]) if key == "color" else image)
    except Image.DecompressionBombError:
        raise ValueRangeError(key, "of too many pixels", f"at most {max_pixels}") from None
    except UnidentifiedImageError:  # its text is the address of an object in memory
        raise ValueRangeError(key, "no such picture", expected) from None
    except (OSError, SyntaxError, ValueError) as error:
        raise ValueRangeError(key, f"no such picture ({error})", expected) from None
    return array.astype(np.int32) if key == "masks" else array


def _raw_array(key: str, content: Mapping[str, object], max_pixels: int) -> NDArray[Any]:
    shape, dtype, data = (content.get(name) for name in ("shape", "dtype", "data"))
    types = RAW_TYPES[key]
    if dtype not in types:
        raise ValueRangeError(f"{key}.dtype", repr(dtype)[:80], " or ".join(types))
    sizes = shape if isinstance(shape, list) else []
    is_sound = len(sizes) == (3 if key == "color" else 2)
    if not is_sound or not all(type(n) is int and 0 < n <= max_pixels for n in sizes):
        expected = "[height, width, 3]" if key == "color" else "[height, width]"
        raise ValueRangeError(f"{key}.shape", repr(shape)[:80], expected)
    _check_pixels(key, sizes[0] * sizes[1], max_pixels)
    kind = np.dtype(str(dtype)).newbyteorder("<")
    raw, wanted = _bytes(f"{key}.data", data, "base64"), prod(sizes) * kind.itemsize
    if len(raw) != wanted:
        found = counted(len(raw), "byte")
        raise ValueRangeError(f"{key}.data", found, f"{wanted}, as its shape says")
    return np.frombuffer(raw, kind).reshape(sizes).astype(kind.newbyteorder("="))


def _bytes(key: str, content: object, expected: str) -> bytes:
    if not isinstance(content, str):
        raise ValueRangeError(key, f"a {type(content).__name__}", expected)
    try:
        return b64decode("".join(content.split()), validate=True)  # lines of 76 letters, as MIME's
    except (NoBase64, ValueError):
        raise ValueRangeError(key, "no base64", expected) from None


def _check_pixels(key: str, pixels: int, most: int) -> None:
    if pixels > most:
        raise ValueRangeError(key, f"of {pixels} pixels", f"at most {most}")
