"""Images of ROS messages: raw, or compressed by the plugins of image_transport.

`compressed` holds a JPEG or PNG file. `compressedDepth` holds twelve bytes, then a PNG of 16 bits:
for 16UC1 the depth; for 32FC1 the inverse depth, scaled by two parameters in the twelve bytes.
"""

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError
from pipelines.storage.images import decode_image

DEPTH_ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
COLOR_ENCODINGS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4}
GREYS = ("mono8", "8UC1")
PLUGINS = ("compressed", "compressedDepth")  # last part of a topic's name, after the raw topic
COLOR_WORDS = ("color", "rgb", "image_raw_color")
INFRARED = re.compile(r"ir\d?|infra(red)?\d?")
PARAMETERS = struct.Struct("<iff")  # format, and A and B of value = A / depth + B


def raw_topic(topic: str) -> str:
    """Return the topic of the raw images of `topic`, which may be a compressed topic."""
    head, _, tail = topic.rpartition("/")
    return head if tail in PLUGINS else topic


def shown_by(topic: str, image: Any) -> str:  # noqa: ANN401 - an extra's
    """Return `color`, `depth`, or `lossy depth` for depth of 8 bits; empty for anything else."""
    encoding, _, packed = _formats(image)
    if not packed:
        if encoding in DEPTH_ENCODINGS:
            is_infrared = encoding != "32FC1" and _shows_infrared(topic)
            return "" if is_infrared else "depth"
        if encoding in GREYS and _shows_depth(topic):
            return "lossy depth"
        return "color" if encoding in COLOR_ENCODINGS else ""
    is_jpeg = "jpeg" in packed or "jpg" in packed
    if "compresseddepth" in packed or (encoding in DEPTH_ENCODINGS and not is_jpeg):
        return "depth"
    if encoding in DEPTH_ENCODINGS or _shows_depth(topic):
        return "lossy depth" if is_jpeg else "depth"
    return "color" if is_jpeg or "png" in packed else ""


def decode(path: Path, image: Any) -> NDArray[Any]:  # noqa: ANN401 - an extra's
    """Return the pixels of a message: (H, W) depth as stored, (H, W, 3) RGB.

    Raises:
        FormatError: the encoding is unknown, or the image is damaged.
    """
    encoding, stated, packed = _formats(image)
    if not packed:
        return _raw(path, image, encoding)
    data = np.asarray(image.data, np.uint8).tobytes()
    if "compresseddepth" not in packed:
        pixels = decode_image(path, data)
        is_grey_color = pixels.ndim == 2 and pixels.dtype == np.uint8
        return np.repeat(pixels[:, :, None], 3, axis=2) if is_grey_color else pixels
    if "rvl" in packed or len(data) < PARAMETERS.size:
        found = f"has depth of the format {stated!r}"
        raise FormatError(path, found, "compressedDepth of format png is read")
    _, a, b = PARAMETERS.unpack_from(data)
    pixels = decode_image(path, data[PARAMETERS.size :])
    if encoding != "32FC1":
        return pixels
    with np.errstate(divide="ignore", invalid="ignore"):
        metres = a / (pixels.astype(np.float32) - np.float32(b))
    return np.where(pixels == 0, np.float32(np.nan), metres).astype(np.float32)


def _formats(image: Any) -> tuple[str, str, str]:  # noqa: ANN401 - an extra's
    """Return the encoding of the raw image, the whole format, and the compression, "" if none."""
    stated = getattr(image, "format", None)
    if stated is None:
        return str(image.encoding), str(image.encoding), ""
    encoding, _, packed = str(stated).partition(";")
    return encoding.strip(), str(stated), (packed or encoding).strip().lower() or "unknown"


def _shows_depth(topic: str) -> bool:
    """Return whether the last part of `topic` that names depth or colour names depth first."""
    for part in reversed(raw_topic(topic).lower().split("/")):  # as in aligned_depth_to_color
        at = {word: part.find(word) for word in ("depth", *COLOR_WORDS) if word in part}
        if at:
            return min(at, key=lambda word: at[word]) == "depth"
    return False


def _shows_infrared(topic: str) -> bool:
    """Return whether `topic` names infrared images, whose 16 bits are intensities, and no depth."""
    words = re.split(r"[/_]", raw_topic(topic).lower())
    return "depth" not in words and any(INFRARED.fullmatch(word) for word in words)


def _raw(path: Path, image: Any, encoding: str) -> NDArray[Any]:  # noqa: ANN401 - an extra's
    """Return the pixels of an Image message, of either byte order; rows may be padded."""
    height, width, step = int(image.height), int(image.width), int(image.step)
    if encoding not in DEPTH_ENCODINGS and encoding not in COLOR_ENCODINGS:
        raise FormatError(
            path, f"has images of {encoding}", f"{', '.join((*DEPTH_ENCODINGS, *COLOR_ENCODINGS))}"
        )
    kind = np.dtype((">" if image.is_bigendian else "<") + DEPTH_ENCODINGS.get(encoding, "u1"))
    row = width * CHANNELS.get(encoding, 1) * kind.itemsize
    data = np.asarray(image.data, np.uint8).ravel()
    if min(height, width) < 1 or step < row or data.size < height * step:
        found = f"has an image of {width}x{height}, {step} bytes a row, in {data.size} bytes"
        raise FormatError(path, found, "copy the whole bag again")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    pixels = rows.view(kind)
    if encoding in DEPTH_ENCODINGS:
        return pixels
    channels = pixels.reshape(height, width, CHANNELS[encoding])
    return np.ascontiguousarray(channels[:, :, COLOR_ENCODINGS[encoding]])
