"""Whole HDF5 files: written atomically with a check sum at the end, and checked before opening.

HDF5 follows addresses that it finds in a file; in a damaged file this may never end, or crash the
process. So the files written here end with a check sum of all bytes before it, which HDF5 ignores.
Files without a check sum, written or changed by other programs, are opened without this check.

A file may also refer to other files, and announce sizes that no memory holds: links are never
followed (D. 123), and sizes are compared with the size of the file.
"""

import math
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from io import FileIO
from pathlib import Path
from typing import Any

import h5py
from h5py import h5d, h5g, h5l, h5o

from pipelines.errors import FormatError
from pipelines.storage.files import atomic_path, existing

MARK = b"symgrasp crc32:\n"
SEAL = struct.Struct(f"<{len(MARK)}sQI")  # mark, bytes before it, their check sum
PIECE = 1 << 22  # bytes that are read at a time
MOST_BYTES = 1 << 28  # larger files have no check sum, for which they would be read once more
MAX_LINKS = 10_000  # groups and datasets; our files have forty
# Datasets together may take this many bytes, or this many times the file: LZF packs up to 88 times,
# but no whole scene so well.
MAX_UNPACKED_BYTES = 2**28
MAX_UNPACK_RATIO = 20
OUTSIDE = "only data in the file itself is read; write it again with all its data inside"


class _NewFile(FileIO):
    """A file that keeps its first error of writing: HDF5 crashes if it cannot write."""

    error: OSError | None = None

    def write(self, data: Any) -> int:  # noqa: ANN401 - a buffer
        left = memoryview(data)
        try:
            while left and self.error is None:
                left = left[super().write(left) or 0 :]
        except OSError as error:
            self.error = error
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - a buffer
        """Read as many bytes as wanted: zeros where nothing was written, as HDF5 expects."""
        view = memoryview(buffer)
        got = super().readinto(view) or 0
        view[got:] = bytes(len(view) - got)
        return len(view)


@contextmanager
def new_h5(path: Path) -> Iterator[h5py.File]:
    """Yield a file to fill, which appears at `path` once it is complete, with its check sum.

    Raises:
        WriteError: there is no space.
    """
    with atomic_path(path) as temporary:
        with _NewFile(temporary, "w+") as stream:
            with h5py.File(stream, "w") as file:
                yield file
            if stream.error is not None:
                raise stream.error
        size = temporary.stat().st_size
        if size <= MOST_BYTES:
            seal = SEAL.pack(MARK, size, _check_sum(temporary, size))
            with temporary.open("ab") as stream:
                stream.write(seal)


def open_h5(
    path: Path,
    cache_bytes: int | None = None,
    *,
    checked: bool = True,
    root_attributes_only: bool = False,
) -> h5py.File:
    """Open the HDF5 file `path` for reading, with a chunk cache of `cache_bytes` a dataset.

    Args:
        path: the file.
        cache_bytes: size of a dataset's chunk cache; HDF5's default if None.
        checked: whether to verify the check sum; once in a process, unless the file changes.
        root_attributes_only: the caller reads nothing else, and root attributes are always within
            the file; so the datasets are not checked, which saves milliseconds.

    Raises:
        FormatError: the file is truncated, damaged or not HDF5.
    """
    found = existing(path).stat()
    if checked and not _is_sound(path, found.st_size, found.st_mtime_ns):
        raise FormatError(
            path, "is damaged: its check sum is wrong", "write it again, or take an intact copy"
        )
    try:
        if not root_attributes_only:
            _refuse_outside(path, found.st_size, found.st_mtime_ns)
        return h5py.File(path, "r", rdcc_nbytes=cache_bytes)
    except (OSError, RuntimeError, KeyError) as error:  # raised by HDF5 on damage
        raise FormatError(
            path, "this is not a whole HDF5 file", "write it again; a cut-off copy cannot be read"
        ) from error


@lru_cache(maxsize=4096)
def _is_sound(path: Path, size: int, written: int) -> bool:
    """Return whether the file of `size` bytes, changed last at `written`, has its check sum."""
    del written  # distinguishes versions of a file in the cache
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


@lru_cache(maxsize=4096)
def _refuse_outside(path: Path, size: int, written: int) -> None:
    """Raise FormatError if the file of `size` bytes has data in other files, or too much data."""
    del written  # distinguishes versions of a file in the cache
    unpacked = 0
    with h5py.File(path, "r") as file:
        for name, found in _objects(path, file.id):
            if isinstance(found, h5d.DatasetID):
                _refuse_elsewhere(path, name, found)
                unpacked += _unpacked_bytes(found)
    most = max(MAX_UNPACKED_BYTES, MAX_UNPACK_RATIO * size)
    if unpacked > most:
        expected = f"of a file of {size} bytes at most {most} are read"
        raise FormatError(path, f"announces datasets of {unpacked} bytes", expected)


def _objects(path: Path, root: h5g.GroupID) -> Iterator[tuple[str, h5g.GroupID | h5d.DatasetID]]:
    """Yield every group and dataset below `root`, once, with its name; links are refused."""
    todo, seen = [("", root)], 0
    while todo:
        above, group = todo.pop()
        for short in group:
            name = f"{above}/{short.decode(errors='replace')}"
            seen += 1
            if group.links.get_info(short).type != h5l.TYPE_HARD:
                raise FormatError(path, f"{name} is a link to something else", OUTSIDE)
            if seen > MAX_LINKS:  # or a group that contains itself
                raise FormatError(path, f"has more than {MAX_LINKS} groups and datasets", OUTSIDE)
            found = h5o.open(group, short)
            yield name, found
            if isinstance(found, h5g.GroupID):
                todo.append((name, found))


def _refuse_elsewhere(path: Path, name: str, dataset: h5d.DatasetID) -> None:
    made = dataset.get_create_plist()
    if made.get_layout() == h5d.VIRTUAL or made.get_external_count() > 0:
        raise FormatError(path, f"{name} has its values in other files", OUTSIDE)


def _unpacked_bytes(dataset: h5d.DatasetID) -> int:
    """Return the bytes in memory of a dataset, or of one of its chunks if that is larger."""
    made, shape = dataset.get_create_plist(), dataset.shape or ()
    chunk = made.get_chunk() if made.get_layout() == h5d.CHUNKED else ()
    size: int = dataset.get_type().get_size()
    return size * max(math.prod(shape), math.prod(chunk))
