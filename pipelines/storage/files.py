"""Read and write whole files: nothing half-written, nothing unpickled, every fault one sentence."""

import errno
import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping, Set
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipelines.contents import MAX_JSON_BYTES, encoding_of, json_value
from pipelines.ending import remove_temporary
from pipelines.errors import NO_SPACE, FormatError, MissingInputError, SymgraspError, WriteError
from pipelines.storage.temporary import new_temporary

NOT_ALLOWED = {errno.EROFS, errno.EACCES, errno.EPERM}
# First bytes, and most bytes, of what Git leaves in place of a large file that is not downloaded.
LFS_HEAD, LFS_BYTES = b"version https://git-lfs", 1024
LONGEST_NAME = 255  # bytes of a file name that file systems accept


def refuse_file_as_folder(path: Path) -> None:
    """Raise SymgraspError if `path`, or a folder above it, is a file."""
    nearest = next((each for each in (path, *path.parents) if each.exists()), path)
    if nearest.exists() and not nearest.is_dir():
        raise SymgraspError(f"{nearest} is a file; name a folder, or a new one, for the output")


def refuse_folder_as_file(path: Path) -> None:
    """Raise SymgraspError if `path` is a folder, before the work whose result it cannot hold."""
    if path.is_dir():
        raise SymgraspError(f"{path} is a folder; name a file, or a new one, for the output")


def make_folder(path: Path) -> None:
    """Make the folder `path` and those above it, if they do not exist.

    Raises:
        SymgraspError: one of them is a file.
        WriteError: there is no space, or the folder above may not be written.
    """
    refuse_file_as_folder(path)
    with _write_errors_named(path, NO_SPACE | NOT_ALLOWED):
        path.mkdir(parents=True, exist_ok=True)


def remove_file(path: Path) -> None:
    """Remove the file `path`, if it exists.

    Raises:
        WriteError: its folder may not be written.
    """
    with _write_errors_named(path, NOT_ALLOWED):
        path.unlink(missing_ok=True)


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path next to `path`; on success it is synced and renamed to `path`.

    Raises:
        WriteError: there is no space, or the folder of `path` may not be written.
    """
    with _write_errors_named(path, NO_SPACE | NOT_ALLOWED):
        make_folder(path.parent)
        temporary = new_temporary(path, lambda made: made.touch(mode=0o600, exist_ok=False))
    try:
        with _write_errors_named(path, NO_SPACE):
            yield temporary
            with temporary.open("rb") as stream:
                os.fsync(stream.fileno())
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    finally:
        remove_temporary(temporary)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder next to `path`; on success it takes the place of `path`.

    If `path` is a link, its target is replaced.

    Raises:
        SymgraspError: `path` is the working folder, or holds it.
        WriteError: there is no space, or the folder of `path` may not be written.
    """
    path = real_path(path) if path.is_symlink() else path
    if path.exists() and _holds_working_folder(path):
        found = f"{path} cannot be replaced while it is the working folder, or holds it"
        raise SymgraspError(f"{found}; run the command from another folder")
    with _write_errors_named(path, NO_SPACE | NOT_ALLOWED):
        make_folder(path.parent)
        temporary = new_temporary(path, lambda made: made.mkdir(mode=0o700))
    try:
        with _write_errors_named(path, NO_SPACE):
            yield temporary
            for file in temporary.rglob("*"):
                if file.is_file():
                    with file.open("rb") as stream:
                        os.fsync(stream.fileno())
        temporary.chmod(0o777 & ~_umask())
        # An earlier folder is moved away whole: half deleted it would still have its stamp.
        earlier = temporary.with_name(f"{temporary.name}.earlier")
        if path.exists():
            path.replace(earlier)
        temporary.replace(path)
        shutil.rmtree(earlier, ignore_errors=True)
    finally:
        remove_temporary(temporary)


def remove_folder(path: Path, *patterns: str) -> None:
    """Remove the folder `path`; of a link to a folder on another disk, its files of `patterns`."""
    if not path.is_symlink():
        shutil.rmtree(path)
        return
    for pattern in patterns:
        for file in path.glob(pattern):
            remove_file(file)


def _holds_working_folder(path: Path) -> bool:
    try:
        return Path.cwd().is_relative_to(real_path(path))
    except FileNotFoundError:  # another program has removed the working folder
        return False


@contextmanager
def _write_errors_named(path: Path, reasons: Set[int]) -> Iterator[None]:
    """Name `path` in errors of these `reasons`, which name a temporary file or none."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.errno not in reasons:
            raise
        raise WriteError(path, os.strerror(error.errno)) from error
    except WriteError as error:
        raise WriteError(path, error.why) from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_bytes(path: Path, *parts: bytes | memoryview) -> None:
    """Write `parts`, one after the other, to `path` atomically."""
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.writelines(parts)


def append_bytes(path: Path, data: bytes) -> None:
    """Write `data` at the end of the file `path`, which is made if it does not exist.

    Raises:
        WriteError: there is no space, or the file or its folder may not be written.
    """
    make_folder(path.parent)
    with _write_errors_named(path, NO_SPACE | NOT_ALLOWED), path.open("ab") as stream:
        stream.write(data)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 to `path` atomically."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Any) -> None:  # noqa: ANN401 - JSON is any of many types
    """Write `content` as indented JSON to `path` atomically."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def finite_json(content: Any) -> Any:  # noqa: ANN401 - JSON is any of many types
    """Return `content` with Python's own numbers, and None for nan, which JSON lacks."""
    if isinstance(content, Mapping):
        return {str(key): finite_json(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite_json(value) for value in content]
    if hasattr(content, "tolist"):  # numpy's scalars and arrays
        return finite_json(content.tolist())
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content


def read_json(path: Path, *, by_hand: bool = False) -> Any:  # noqa: ANN401 - JSON
    """Read the JSON file `path`; in a file that people write, names must not be repeated.

    Raises:
        FormatError: the file is not JSON, or beyond the bounds of `contents.json_value`.
    """
    return json_value(path, read_bytes(path, MAX_JSON_BYTES), by_hand=by_hand)


def read_bytes(path: Path, most: int) -> bytes:
    """Read the whole file `path`.

    Raises:
        FormatError: it has more than `most` bytes.
    """
    with existing(path).open("rb") as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise FormatError(path, f"has more than {most} bytes", "a smaller file is expected")
    return data


def read_text(path: Path, most: int = MAX_JSON_BYTES) -> str:
    """Read the text file `path` of at most `most` bytes; bytes of no character become U+FFFD."""
    data = read_bytes(path, most)
    return data.decode(encoding_of(data), errors="replace")


def is_file(path: Path) -> bool:
    """Return whether `path` is a file; False also if it is no valid path, as in a damaged file."""
    try:
        return path.is_file()
    except OSError:  # too long, for one
        return False


def existing(path: Path, made_by: str = "") -> Path:
    """Return `path` if it is a file, not a pipe or a device, which may never end.

    Raises:
        MissingInputError: there is no such file, which the command `made_by` writes.
        SymgraspError: there is no such file, and no command is named; or it is not downloaded.
    """
    if not is_file(path):
        if made_by:
            raise MissingInputError(path, made_by)
        found = "is no plain file" if path.exists() else "does not exist"
        raise SymgraspError(f"{path} {found}; give another path, or restore the file")
    if path.stat().st_size <= LFS_BYTES:
        with path.open("rb") as stream:
            if stream.read(len(LFS_HEAD)) == LFS_HEAD:
                raise SymgraspError(f"{path} is a pointer of Git LFS; run `git lfs pull`")
    return path


def real_path(path: Path) -> Path:
    """Return the absolute `path` without links; a circle of links stays unresolved.

    `Path.resolve` raises RuntimeError on a circle.
    """
    return Path(os.path.realpath(path))


def file_behind(path: Path) -> Path:
    """Return the path to write where a user names `path`: of a link to a file, the file's.

    Links to folders stay, and so do other paths. A file that `atomic_path` writes replaces a link.
    """
    return real_path(path) if path.is_symlink() and not path.is_dir() else path


def within(folder: Path, path: Path) -> Path:
    """Return `path`, somewhere below the output folder `folder`.

    Raises:
        SymgraspError: a link on the way leads out of the folder.
    """
    if not real_path(path.parent).is_relative_to(real_path(folder)):
        raise SymgraspError(
            f"{path.parent} is a link that leads out of {folder}; remove it, or name another output"
        )
    return path


@contextmanager
def open_safetensors(path: Path, framework: str = "np") -> Iterator[Any]:
    """Yield the file, with tensors of `framework` (`np` needs no torch, `pt` is torch).

    Raises:
        FormatError: the file is truncated, or not safetensors.
    """
    from safetensors import SafetensorError, safe_open  # noqa: PLC0415 - few commands need it

    try:
        with safe_open(str(existing(path)), framework=framework) as file:
            yield file
    except (SafetensorError, TypeError, ValueError) as error:
        raise FormatError(
            path, f"this is not a whole safetensors file ({error})", "give weights or train again"
        ) from error
