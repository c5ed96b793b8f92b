"""Numbers in MATLAB 5 files (`meta.mat`), read by the published format.

scipy's reader crashes the process on some damaged files; this reader knows numeric arrays only.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import FormatError
from pipelines.storage.files import read_bytes

HEAD = 128  # bytes; the last two give the byte order
ORDERS = {b"IM": "<", b"MI": ">"}
MATRIX, COMPRESSED = 14, 15
STORED = {
    **{1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4"},
    **{7: "f4", 9: "f8", 12: "i8", 13: "u8"},
}
CLASSES = {
    **{6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2"},
    **{11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"},
}
COMPLEX = 8  # a bit of the flags
MAX_BYTES = 2**24  # of a file, and of its arrays unpacked; a frame's file has some thousand
Element = tuple[int, bytes]


def read_mat(path: Path) -> dict[str, NDArray[Any]]:
    """Read the numeric arrays of a MATLAB 5 file; texts, structures and cells are left out.

    Raises:
        FormatError: damaged, cut off, or of another version: 7.3 is HDF5, `save -v7` writes 5.
    """
    data = read_bytes(path, MAX_BYTES)
    order = ORDERS.get(data[HEAD - 2 : HEAD])
    if order is None or data.startswith(b"MATLAB 7.3"):
        raise FormatError(
            path, "this is no MATLAB 5 file", "save it with `save -v7` or scipy.io.savemat"
        )
    arrays, room = {}, MAX_BYTES
    try:
        for kind, body in _elements(data[HEAD:], order):
            if kind == COMPRESSED:
                inflated = _inflated(body, room)
                room -= len(inflated)
                kind, body = next(_elements(inflated, order))  # noqa: PLW2901
            named = _numeric(body, order) if kind == MATRIX else None
            if named is not None:
                arrays[named[0]] = named[1]
    except (ValueError, TypeError, LookupError, StopIteration, struct.error, zlib.error) as error:
        raise FormatError(
            path, f"not a whole MATLAB 5 file ({error})", "a meta .mat is expected"
        ) from error
    return arrays


def _elements(data: bytes, order: str) -> Iterator[Element]:
    """Split `data` into its elements: type and bytes; short ones share a word with their tag."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start = at + 8
        if kind >> 16:
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
            end = at + 8
        else:
            end = start + size + (0 if kind == COMPRESSED else -size % 8)
        body = data[start : start + size]
        if len(body) != size:
            raise ValueError("it is cut off")
        yield kind, body
        at = end


def _inflated(body: bytes, most: int) -> bytes:
    inflate = zlib.decompressobj()
    data = inflate.decompress(body, max(1, most))
    if not inflate.eof:
        raise ValueError("a compressed array is cut off or too large")
    return data


def _numeric(body: bytes, order: str) -> tuple[str, NDArray[Any]] | None:
    """Return the name and the values of a matrix element, None if it holds no real numbers."""
    parts = _elements(body, order)
    flags = int(np.frombuffer(next(parts)[1], f"{order}u4")[0])
    if flags & 0xFF not in CLASSES or flags >> 8 & COMPLEX:
        return None
    shape = tuple(int(size) for size in np.frombuffer(next(parts)[1], f"{order}i4"))
    name = next(parts)[1].decode("ascii", errors="replace")
    kind, stored = next(parts, (9, b""))  # an empty array may lack its values
    values = np.frombuffer(stored, order + STORED[kind])
    if min(shape, default=-1) < 0 or math.prod(shape) != values.size:
        raise ValueError(f"`{name}` of shape {shape} has {values.size} values")
    with np.errstate(all="ignore"):
        return name, values.astype(CLASSES[flags & 0xFF]).reshape(shape, order="F")
