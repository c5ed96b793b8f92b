"""Whole HDF5 files: written at once with a check sum behind, and checked before they are opened.

HDF5 follows addresses that it finds in a file; in a damaged one that may never end or take the
process with it. So the files written here end with a check sum of all before it, which HDF5
ignores. Files without one, of other programs or changed by them since, are opened as they are.

A file may also name others to be read in its place, and announce sizes that no memory holds: links
are followed nowhere (D. 123), and sizes compared with that of the file.
"""

import math
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import h5py
from h5py import h5d, h5g, h5l, h5o

from pipelines.errors import FormatError
from pipelines.storage.files import atomic_path, existing

MARK = b"symgrasp crc32:\n"
SEAL = struct.Struct(f"<{len(MARK)}sQI")  # mark, bytes before it, their check sum
PIECE = 1 << 22  # bytes that are read at a time
MOST_BYTES = 1 << 28  # of larger files no check sum is made: that would be a second reading
MAX_LINKS = 10_000  # groups and datasets; ours have forty
# Datasets together may take this many bytes, or this many times the file: LZF packs up to 88 times,
# but no whole scene so well.
MAX_UNPACKED_BYTES = 2**28
MAX_UNPACK_RATIO = 20
OUTSIDE = "only what lies in the file itself is read: write it again without"


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
        cache_bytes: of a dataset's chunk cache; HDF5's own if None.
        checked: whether to compare it with its check sum; once in a process, unless it is changed.
        root_attributes_only: nothing else is read, and these lie in the file itself; so its
            datasets, of which a list takes milliseconds, are not looked at.

    Raises:
        FormatError: the file is truncated, damaged or not HDF5.
    """
    found = existing(path).stat()
    if checked and not _is_sound(path, found.st_size, found.st_mtime_ns):
        raise FormatError(
            path, "is damaged: its check sum is another", "write it again, or take a sound copy"
        )
    try:
        if not root_attributes_only:
            _refuse_outside(path, found.st_size, found.st_mtime_ns)
        return h5py.File(path, "r", rdcc_nbytes=cache_bytes)
    except (OSError, RuntimeError, KeyError) as error:  # HDF5's, of what it finds damaged
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


@lru_cache(maxsize=4096)
def _refuse_outside(path: Path, size: int, written: int) -> None:
    """Raise FormatError if the file of `size` bytes leads outside itself, or beyond all memory."""
    del written  # tells versions of a file apart in the cache
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
            if seen > MAX_LINKS:  # or a group that lies in itself
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
