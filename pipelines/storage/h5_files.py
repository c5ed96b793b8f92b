"""Whole HDF5 files: written at once with a check sum behind, and checked before they are opened.

HDF5 follows addresses that it finds in a file; in a damaged one that may never end or take the
process with it. So the files written here end with a check sum of all before it, which HDF5
ignores. Files without one, of other programs or changed by them since, are opened as they are.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import h5py

from pipelines.errors import FormatError
from pipelines.storage.files import atomic_path, existing

MARK = b"symgrasp crc32:\n"
SEAL = struct.Struct(f"<{len(MARK)}sQI")  # mark, bytes before it, their check sum
PIECE = 1 << 22  # bytes that are read at a time
MOST_BYTES = 1 << 28  # of larger files no check sum is made: that would be a second reading


@contextmanager
def new_h5(path: Path) -> Iterator[h5py.File]:
    """Yield a file to fill, which appears at `path` once it is whole, with its check sum."""
    with atomic_path(path) as temporary:
        with h5py.File(temporary, "w") as file:
            yield file
        size = temporary.stat().st_size
        if size <= MOST_BYTES:
            seal = SEAL.pack(MARK, size, _check_sum(temporary, size))
            with temporary.open("ab") as stream:
                stream.write(seal)


def open_h5(path: Path, cache_bytes: int | None = None, *, checked: bool = True) -> h5py.File:
    """Open the HDF5 file `path` for reading, with a chunk cache of `cache_bytes` a dataset.

    `checked`: whether to compare it with its check sum; once in a process, unless it is changed.

    Raises:
        FormatError: the file is truncated, damaged or not HDF5.
    """
    found = existing(path).stat()
    if checked and not _is_sound(path, found.st_size, found.st_mtime_ns):
        raise FormatError(
            path, "is damaged: its check sum is another", "write it again, or take a sound copy"
        )
    try:
        return h5py.File(path, "r", rdcc_nbytes=cache_bytes)
    except OSError as error:
        raise FormatError(
            path, "this is not a whole HDF5 file", "write it again; a cut-off copy cannot be read"
        ) from error


@lru_cache(maxsize=4096)
def _is_sound(path: Path, size: int, written: int) -> bool:
    """Return whether the file of `size` bytes, `written` then, is as its check sum says."""
    del written  # tells versions of a file apart in the cache
    if size < SEAL.size:
        return True
    with path.open("rb") as stream:
        stream.seek(-SEAL.size, os.SEEK_END)
        mark, length, expected = SEAL.unpack(stream.read(SEAL.size))
    if mark != MARK or length != size - SEAL.size:
        return True
    return bool(_check_sum(path, length) == expected)


def _check_sum(path: Path, length: int) -> int:
    """Return the CRC-32 of the first `length` bytes of a file."""
    result, left = 0, length
    with path.open("rb") as stream:
        while left > 0 and (piece := stream.read(min(PIECE, left))):
            result, left = zlib.crc32(piece, result), left - len(piece)
    return result
