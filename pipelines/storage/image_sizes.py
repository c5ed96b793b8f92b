"""Pixels of images by their headers, known before any of them is decoded."""

import struct
from collections.abc import Iterator

# JPEG's starts of frame, which hold its size; the gaps are tables.
FRAME_STARTS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
TIFF_ORDERS = {b"II": "<", b"MM": ">"}
TIFF_SIDES = ((256, 257), (322, 323))  # tags of width and height, of the image and of a tile
TIFF_INTEGERS = {3: "H", 4: "I", 16: "Q"}
MOST_TAGS = 4096
EXR_WINDOW = b"dataWindow\0box2i\0"


def pixels_of(data: bytes) -> int | None:
    """Return the number of pixels that a PNG, JPEG, TIFF, BMP or EXR announces.

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
    at = 2
    while True:
        mark, kind, length = struct.unpack_from(">BBH", data, at)
        if mark != 0xFF:
            raise LookupError("no marker where one is due")
        if kind in FRAME_STARTS:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return height, width
        at += 1 if kind == 0xFF else 2 + length


def _tiff_pixels(data: bytes, order: str) -> int:
    """Return the pixels of the first image of a TIFF, or of one of its tiles if that is larger."""
    tags = dict(_tiff_tags(data, order))
    sides = [(tags.get(width, 0), tags.get(height, 0)) for width, height in TIFF_SIDES]
    if not all(sides[0]):
        raise LookupError("no size")
    return max(width * height for width, height in sides)


def _tiff_tags(data: bytes, order: str) -> Iterator[tuple[int, int]]:
    """Yield the tags of the first directory that hold one whole number, with it."""
    is_big = struct.unpack_from(f"{order}H", data, 2)[0] == 43
    at = struct.unpack_from(f"{order}{'Q' if is_big else 'I'}", data, 8 if is_big else 4)[0]
    count, size, value_at = (
        *struct.unpack_from(f"{order}{'Q' if is_big else 'H'}", data, at),
        *((20, 12) if is_big else (12, 8)),
    )
    at += 8 if is_big else 2
    for entry in range(min(count, MOST_TAGS)):
        tag, kind = struct.unpack_from(f"{order}HH", data, at + entry * size)
        if kind in TIFF_INTEGERS:
            place = at + entry * size + value_at
            yield tag, struct.unpack_from(f"{order}{TIFF_INTEGERS[kind]}", data, place)[0]
