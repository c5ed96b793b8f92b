"""Read and write whole files: nothing half-written, nothing unpickled, every fault one sentence."""

import json
import os
import shutil
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipelines.ending import remove_temporary
from pipelines.errors import FormatError, SymgraspError
from pipelines.storage.temporary import new_temporary

# A zip member that claims to unpack to more than this many times its size is a zip bomb.
MAX_UNPACK_RATIO = 2000
TO_RGB = {3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGB}  # by the number of channels
COLOR_TYPES = (np.uint8, np.uint16, np.float32)  # that OpenCV converts; TIFF has others too
JPEG_TAIL = 4096  # bytes in which the end mark must lie; some cameras pad with zeros
LONGEST_NAME = 255  # bytes that file systems take
MAX_UNPACK_BYTES = 16 * 2**30
# What numpy and zipfile raise on files that are cut off, damaged, encrypted, or claim a size that
# does not fit into memory.
DAMAGED = (
    ArithmeticError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it is synced and renamed to `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = new_temporary(path, lambda made: made.touch(mode=0o600, exist_ok=False))
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    finally:
        remove_temporary(temporary)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path`; on success it takes the place of `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = new_temporary(path, lambda made: made.mkdir(mode=0o700))
    try:
        yield temporary
        for file in temporary.rglob("*"):
            if file.is_file():
                with file.open("rb") as stream:
                    os.fsync(stream.fileno())
        temporary.chmod(0o777 & ~_umask())
        # An earlier folder is moved away whole: half deleted it would still bear its stamp.
        earlier = temporary.with_name(f"{temporary.name}.earlier")
        if path.exists():
            path.replace(earlier)
        temporary.replace(path)
        shutil.rmtree(earlier, ignore_errors=True)
    finally:
        remove_temporary(temporary)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_bytes(path: Path, data: bytes) -> None:
    """Write `data` to `path` atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 to `path` atomically."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Any) -> None:  # noqa: ANN401 - JSON is any of many types
    """Write `content` as indented JSON to `path` atomically."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:  # noqa: ANN401 - JSON is any of many types
    """Read the JSON file `path`.

    Raises:
        FormatError: the file is not JSON.
    """
    try:
        return json.loads(existing(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # not text, not JSON, too many digits, too deep
        raise FormatError(
            path, f"this is not JSON ({error})", "a JSON text in UTF-8 is expected"
        ) from error


def is_file(path: Path) -> bool:
    """Return whether `path` is a file; False too where it cannot be a path, as damage makes it."""
    try:
        return path.is_file()
    except OSError:  # too long, for one
        return False


def existing(path: Path) -> Path:
    """Return `path` if it is a file.

    Raises:
        SymgraspError: there is no such file.
    """
    if not is_file(path):
        raise SymgraspError(f"{path} does not exist; give the path of an existing file")
    return path


def write_npy(path: Path, array: NDArray[Any]) -> None:
    """Write `array` as .npy atomically."""
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.save(stream, array, allow_pickle=False)


def read_npy(path: Path) -> NDArray[Any]:
    """Read a plain .npy array.

    Raises:
        FormatError: truncated, not .npy, or pickled objects.
    """
    try:
        with _old_headers_unmentioned():
            array = np.load(existing(path), allow_pickle=False)
    except DAMAGED as error:
        raise FormatError(
            path,
            f"this is not a whole .npy file of numbers ({error})",
            "plain arrays are read, pickles never",
        ) from error
    if not isinstance(array, np.ndarray):
        raise FormatError(path, "this is an .npz archive", "a single .npy array is expected")
    return array


@contextmanager
def _old_headers_unmentioned() -> Iterator[None]:
    """Keep numpy from warning of headers that Python 2 wrote: they are read well."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


def write_npz(path: Path, *, compress: bool = True, **arrays: NDArray[Any]) -> None:
    """Write named `arrays` as .npz atomically."""
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        if compress:
            np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
        else:
            np.savez(stream, **arrays)  # type: ignore[arg-type]


def read_npz(path: Path, required: Sequence[str] = ()) -> dict[str, NDArray[Any]]:
    """Read all arrays of an .npz file.

    Raises:
        FormatError: truncated, not .npz, pickled, a zip bomb, or a required array is missing.
    """
    try:
        with zipfile.ZipFile(existing(path)) as archive:
            _refuse_bomb(path, archive.infolist())
        with _old_headers_unmentioned(), np.load(path, allow_pickle=False) as content:
            missing = sorted(set(required) - set(content.files))
            if missing:
                raise FormatError(
                    path,
                    f"lacks the arrays {', '.join(missing)}",
                    f"it holds {', '.join(content.files)}",
                )
            return {name: content[name] for name in content.files}
    except DAMAGED as error:
        raise FormatError(
            path,
            f"this is not a whole .npz file of numbers ({error})",
            "plain arrays are read, pickles never",
        ) from error


def _refuse_bomb(path: Path, members: Sequence[zipfile.ZipInfo]) -> None:
    unpacked = sum(member.file_size for member in members)
    packed = max(1, sum(member.compress_size for member in members))
    if unpacked > MAX_UNPACK_BYTES or (unpacked > 2**30 and unpacked / packed > MAX_UNPACK_RATIO):
        raise FormatError(
            path,
            f"unpacks from {packed} to {unpacked} bytes",
            f"at most {MAX_UNPACK_BYTES} bytes and {MAX_UNPACK_RATIO} times the size are read",
        )


def read_image(path: Path) -> NDArray[Any]:
    """Read an image as stored: (H, W) or (H, W, 3) RGB, 8 or 16 bit.

    Raises:
        FormatError: truncated or not an image.
    """
    return decode_image(path, existing(path).read_bytes())


def decode_image(path: Path, data: bytes) -> NDArray[Any]:
    """Return the image in `data`, the bytes of an image file in `path`; see `read_image`."""
    _refuse_truncated(path, data)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:  # damage that OpenCV notices too late for an answer of None
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
    # OpenCV fills the missing rows of a cut-off image and says nothing.
    if data.startswith(b"\x89PNG") and b"IEND" not in data[-16:]:
        raise FormatError(path, "this PNG is cut off", "copy the whole file again")
    if data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data[-JPEG_TAIL:]:
        raise FormatError(path, "this JPEG is cut off", "copy the whole file again")


def write_image(path: Path, image: NDArray[Any]) -> None:
    """Write `image`, (H, W) or (H, W, 3) RGB, 8 or 16 bit, atomically; the suffix says the kind."""
    try:
        data = encode_image(image, path.suffix)
    except SymgraspError as error:
        raise FormatError(path, str(error), "use uint8 or uint16") from error
    write_bytes(path, data)


def encode_image(image: NDArray[Any], suffix: str, jpeg_quality: int = 95) -> bytes:
    """Return `image`, (H, W) or (H, W, 3) RGB, as the bytes of a file with that suffix."""
    stored = image[:, :, ::-1] if image.ndim == 3 else image
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if suffix == ".jpg" else []
    done, data = cv2.imencode(suffix, np.ascontiguousarray(stored), options)
    if not done:
        raise SymgraspError(f"an image of {image.dtype} cannot be stored as {suffix}")
    return data.tobytes()
