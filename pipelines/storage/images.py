"""Images as arrays: read whole, of bounded size, and written atomically."""

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.contents import MAX_PIXELS
from pipelines.errors import FormatError, SymgraspError
from pipelines.storage.files import read_bytes, write_bytes

TO_RGB = {3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGB}  # by the number of channels
COLOR_TYPES = (np.uint8, np.uint16, np.float32)  # that OpenCV converts; TIFF has others too
MAX_IMAGE_BYTES = 2**29  # 16 bit RGB of MAX_PIXELS, not compressed, and more
# JPEG's starts of frame, which hold its size; the gaps are tables.
FRAME_STARTS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
SCAN_START = 0xDA
TIFF_ORDERS = {b"II": "<", b"MM": ">"}
TIFF_SIDES = ((256, 257), (322, 323))  # tags of width and height, of the image and of a tile
TIFF_INTEGERS = {3: "H", 4: "I", 16: "Q"}
MOST_TAGS = 4096
WEBP_SIDE = 2**14 - 1  # bits of a side in WebP's pictures
COMMENTS = rb"(?:\s|#[^\n]*\n)+"
LONGEST_HEAD = 2**12
NETPBM_HEAD = re.compile(rb"P[56Ff]" + COMMENTS + rb"(\d{1,9})" + COMMENTS + rb"(\d{1,9})\s")
EXR_WINDOW = b"dataWindow\0box2i\0"


def read_image(path: Path) -> NDArray[Any]:
    """Read an image as stored: (H, W) or (H, W, 3) RGB, 8 or 16 bit.

    Raises:
        FormatError: truncated or not an image.
    """
    return decode_image(path, read_bytes(path, MAX_IMAGE_BYTES))


def decode_image(path: Path, data: bytes) -> NDArray[Any]:
    """Return the image in `data`, the bytes of an image file in `path`; see `read_image`."""
    _refuse_truncated(path, data)
    pixels, numbers = pixels_of(data), np.frombuffer(data, np.uint8)
    if pixels is not None and pixels > MAX_PIXELS:
        expected = f"at most {MAX_PIXELS} are read: make it smaller"
        raise FormatError(path, f"an image of {pixels} pixels", expected)
    try:
        image = None if pixels is None else cv2.imdecode(numbers, cv2.IMREAD_UNCHANGED)
    except cv2.error:  # damage on which OpenCV raises instead of returning None
        image = None
    if image is None:
        raise FormatError(path, "this is not a whole image", "a PNG, JPEG or TIFF file is expected")
    return _as_rgb(image) if image.ndim == 3 else image


def _as_rgb(image: NDArray[Any]) -> NDArray[Any]:
    """Return an image (H, W, 3 or more) as OpenCV reads it, BGR and perhaps alpha, as RGB."""
    code = TO_RGB.get(image.shape[2])
    if code is not None and image.dtype in COLOR_TYPES:
        return cv2.cvtColor(image, code)  # much quicker than a copy of strides
    if image.shape[2] == 4:
        image = image[:, :, :3]
    return np.ascontiguousarray(image[:, :, ::-1])


def _refuse_truncated(path: Path, data: bytes) -> None:
    # OpenCV fills the missing rows of a cut-off image without an error. Cameras and phones add
    # padding, previews and videos after the end.
    if data.startswith(b"\x89PNG") and not _has_png_end(data):
        raise FormatError(path, "this PNG is cut off", "copy the whole file again")
    if data.startswith(b"\xff\xd8") and not _has_jpeg_end(data):
        raise FormatError(path, "this JPEG is cut off", "copy the whole file again")


def _has_png_end(data: bytes) -> bool:
    at = 8
    while at + 8 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"IEND":
            return True
        at += 12 + length
    return False


def _has_jpeg_end(data: bytes) -> bool:
    """Return whether the end mark follows the first scan, whose data never contain it.

    True for damage before the scan, which is no missing end.
    """
    try:
        scan = next(at for kind, at in _jpeg_segments(data) if kind == SCAN_START)
    except struct.error:
        return False
    except LookupError:
        return True
    return data.find(b"\xff\xd9", scan) >= 0


def write_image(path: Path, image: NDArray[Any]) -> None:
    """Write `image`, (H, W) or (H, W, 3) RGB, 8 or 16 bit, atomically in the suffix's format."""
    try:
        data = encode_image(image, path.suffix)
    except SymgraspError as error:
        raise FormatError(path, str(error), "use uint8 or uint16, and .png") from error
    write_bytes(path, data)


def encode_image(image: NDArray[Any], suffix: str, jpeg_quality: int = 95) -> bytes:
    """Return `image`, (H, W) or (H, W, 3) RGB, as the bytes of a file with that suffix."""
    stored = image[:, :, ::-1] if image.ndim == 3 else image
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if suffix == ".jpg" else []
    try:
        done, data = cv2.imencode(suffix, np.ascontiguousarray(stored), options)
    except cv2.error:  # a suffix or a type that OpenCV does not know
        done = False
    if not done:
        raise SymgraspError(f"an image of {image.dtype} cannot be stored as {suffix or 'a file'}")
    return data.tobytes()


def pixels_of(data: bytes) -> int | None:
    """Return the number of pixels that a PNG, JPEG, TIFF, BMP, WebP, netpbm or EXR announces.

    None if the header is cut off, or of another format.
    """
    try:
        if data.startswith(b"\x89PNG"):
            width, height = struct.unpack_from(">II", data, 16)
        elif data.startswith(b"\xff\xd8"):
            height, width = _jpeg_size(data)
        elif data[:2] in TIFF_ORDERS:
            return _tiff_pixels(data, TIFF_ORDERS[data[:2]])
        elif data.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", data, 18)
        elif data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            width, height = _webp_size(data)
        elif head := NETPBM_HEAD.match(data, 0, LONGEST_HEAD):
            width, height = map(int, head.groups())
        elif data.startswith(b"\x76\x2f\x31\x01") and EXR_WINDOW in data:
            left, top, right, bottom = struct.unpack_from(
                "<iiii", data, data.index(EXR_WINDOW) + len(EXR_WINDOW) + 4
            )
            width, height = right - left + 1, bottom - top + 1
        else:
            return None
    except (struct.error, LookupError):
        return None
    return abs(int(width) * int(height))


def _jpeg_size(data: bytes) -> tuple[int, int]:
    at = next(at for kind, at in _jpeg_segments(data) if kind in FRAME_STARTS)
    height, width = struct.unpack_from(">HH", data, at + 5)
    return height, width


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield the kind and the place of each segment before the data of the first scan.

    Raises:
        struct.error: the data end before a scan.
        LookupError: there is no segment where one is due.
    """
    at = 2
    while True:
        mark, kind, length = struct.unpack_from(">BBH", data, at)
        if mark != 0xFF:
            raise LookupError("no marker where one is due")
        if kind != 0xFF:  # a fill byte before the mark
            yield kind, at
        at += 1 if kind == 0xFF else 2 + length


def _webp_size(data: bytes) -> tuple[int, int]:
    """Return the size in the first chunk: of an extended, a lossless or a lossy picture."""
    if data[12:16] == b"VP8X":
        width, wide, height, high = struct.unpack_from("<HBHB", data, 24)
        return width + (wide << 16) + 1, height + (high << 16) + 1
    if data[12:16] == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return (bits & WEBP_SIDE) + 1, (bits >> 14 & WEBP_SIDE) + 1
    width, height = struct.unpack_from("<HH", data, 26)
    return width & WEBP_SIDE, height & WEBP_SIDE


def _tiff_pixels(data: bytes, order: str) -> int:
    """Return the pixels of the first image of a TIFF, or of one of its tiles if that is larger."""
    tags = dict(_tiff_tags(data, order))
    sides = [(tags.get(width, 0), tags.get(height, 0)) for width, height in TIFF_SIDES]
    if not all(sides[0]):
        raise LookupError("no size")
    return max(width * height for width, height in sides)


def _tiff_tags(data: bytes, order: str) -> Iterator[tuple[int, int]]:
    """Yield the tags of the first directory with one whole number as value, and the value."""
    is_big = struct.unpack_from(f"{order}H", data, 2)[0] == 43
    word, number, size, value_at = ("Q", "Q", 20, 12) if is_big else ("I", "H", 12, 8)
    at = struct.unpack_from(f"{order}{word}", data, struct.calcsize(word))[0]
    count = struct.unpack_from(f"{order}{number}", data, at)[0]
    at += struct.calcsize(number)
    for entry in range(min(count, MOST_TAGS)):
        tag, kind = struct.unpack_from(f"{order}HH", data, at + entry * size)
        if kind in TIFF_INTEGERS:
            place = at + entry * size + value_at
            yield tag, struct.unpack_from(f"{order}{TIFF_INTEGERS[kind]}", data, place)[0]
