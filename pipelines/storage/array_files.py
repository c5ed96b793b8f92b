"""Read and write .npy and .npz files of numbers: sizes are checked first, pickles never opened."""

import io
import math
import os
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from pipelines.contents import UNFIT
from pipelines.errors import FormatError
from pipelines.storage.files import atomic_path, existing, write_bytes

MAX_UNPACK_BYTES = 2**28  # of all arrays of an .npz: a frame of MAX_PIXELS and its colours
NPY_MAGIC = b"\x93NUMPY"
NPY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
NPY_HEADER_BYTES = 2**16  # numpy reads no longer headers
# Errors of numpy and zipfile on files that are cut off, damaged, encrypted, or claim a size that
# does not fit into memory.
DAMAGED = (
    *UNFIT,
    EOFError,
    RuntimeError,
    SyntaxError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


def write_npy(path: Path, array: NDArray[Any]) -> None:
    """Write `array` as .npy atomically."""
    content = io.BytesIO()  # numpy's own writing of files hides the error of a full disk
    np.save(content, array, allow_pickle=False)
    with content.getbuffer() as data:
        write_bytes(path, data)


def read_npy(path: Path) -> NDArray[Any]:
    """Read a plain .npy array.

    Raises:
        FormatError: truncated, not .npy, or pickled objects.
    """
    with _plain_arrays(path, ".npy"), existing(path).open("rb") as stream:
        _refuse_npy(path, stream, path.stat().st_size)
        stream.seek(0)
        array = np.load(stream, allow_pickle=False)
    if not isinstance(array, np.ndarray):
        raise FormatError(path, "this is an .npz archive", "a single .npy array is expected")
    return array


@contextmanager
def _plain_arrays(path: Path, suffix: str) -> Iterator[None]:
    """Raise FormatError if numpy cannot read a file; headers of Python 2 give no warning."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            yield
    except PermissionError:  # no damage
        raise
    except DAMAGED as error:
        found = f"this is not a whole {suffix} file of numbers"
        if "pickle" not in str(error):  # numpy then advises to unpickle the file
            found += f" ({error})"
        raise FormatError(path, found, "plain arrays are read, pickles never") from error


def write_npz(path: Path, *, compress: bool = True, **arrays: NDArray[Any]) -> None:
    """Write named `arrays` as .npz atomically."""
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        (np.savez_compressed if compress else np.savez)(stream, **arrays)  # type: ignore[arg-type]


def _refuse_npy(path: Path, stream: IO[bytes], size: int) -> None:
    """Raise FormatError if an array's header announces more than the `size` bytes of its file."""
    if stream.read(len(NPY_MAGIC)) != NPY_MAGIC:
        return  # numpy reports it
    stream.seek(-len(NPY_MAGIC), os.SEEK_CUR)
    version = np.lib.format.read_magic(stream)
    read_header = NPY_HEADERS.get(version)
    if read_header is None:
        return
    shape, _order, dtype = read_header(stream)
    if not dtype.hasobject and math.prod(shape) * dtype.itemsize > size:
        found = f"announces an array of shape {shape} and type {dtype}"
        raise FormatError(path, found, f"its {size} bytes do not hold it")


def read_npz(
    path: Path, required: Sequence[str] = (), *, bytes_of_each: int | None = None
) -> dict[str, NDArray[Any]]:
    """Read all arrays of an .npz file, `MAX_UNPACK_BYTES` at most together.

    `bytes_of_each`: most bytes of one array, in place of the bound of all arrays.

    Raises:
        FormatError: truncated, not .npz, pickled, larger, or a required array is missing.
    """
    with _plain_arrays(path, ".npz"):
        with zipfile.ZipFile(existing(path)) as archive:
            _refuse_bomb(path, archive, bytes_of_each)
        with np.load(path, allow_pickle=False) as content:
            missing = sorted(set(required) - set(content.files))
            if missing:
                found = f"lacks the arrays {', '.join(missing)}"
                raise FormatError(path, found, f"it holds {', '.join(content.files)}")
            arrays = {name: content[name] for name in content.files}
    # numpy gives a member of another format as its bytes.
    others = [name for name, each in arrays.items() if not isinstance(each, np.ndarray)]
    if others:
        raise FormatError(path, f"`{others[0]}` is no array", "an .npz of arrays is expected")
    return arrays


def _refuse_bomb(path: Path, archive: zipfile.ZipFile, bytes_of_each: int | None) -> None:
    sizes = [member.file_size for member in archive.infolist()]
    if bytes_of_each is None:
        kind, unpacked, most = "", sum(sizes), MAX_UNPACK_BYTES
    else:
        kind, unpacked, most = " in one array", max(sizes, default=0), bytes_of_each
    if unpacked > most:
        raise FormatError(path, f"unpacks to {unpacked} bytes{kind}", f"at most {most} are read")
    for member in archive.infolist():
        with archive.open(member) as stream:
            _refuse_npy(path, io.BytesIO(stream.read(NPY_HEADER_BYTES)), member.file_size)
