"""One run at a time on an output, by a lock that a killed run does not leave behind.

The operating system locks a small file next to the output, `.NAME.STAGE.lock`, which names the
holder. The run removes the file; the file of a killed run is not locked, and the next run removes
it.
"""

import inspect
import json
import os
import socket
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import wraps
from operator import attrgetter
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from pipelines.ending import create_temporary, remove_temporary
from pipelines.errors import SymgraspError
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.files import real_path, refuse_file_as_folder

if sys.platform != "win32":  # runs on Windows do not detect each other
    import fcntl

P = ParamSpec("P")
R = TypeVar("R")
LONGEST_RECORD = 4096  # bytes of a lock file


class OutputInUseError(SymgraspError):
    """Another run writes the same output."""

    def __init__(self, output: Path, stage: str, holder: Mapping[str, Any]) -> None:
        process, since = holder.get("process", "of unknown number"), holder.get("since", "")
        host = holder.get("host", "")
        where = f" on {host}" if host and host != socket.gethostname() else ""
        when = f" since {since}" if since else ""
        super().__init__(
            f"{output} is being written by another `symgrasp {stage}`, process {process}{where}"
            f"{when}; wait for its end or end it, or choose another output"
        )
        self.arguments = (output, stage, holder)


def one_run_at_a_time(stage: str, *names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let the `run` of `stage` refuse an output that another run of the stage is writing.

    A dry run and all but the first process of torchrun write nothing and need no lock.

    Args:
        stage: the command's name.
        names: parameters of `run`, dotted for a field of a parameter; the first that is not None
            is the output.
    """

    def decorate(run: Callable[P, R]) -> Callable[P, R]:
        signature = inspect.signature(run)

        @wraps(run)
        def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
            given = signature.bind(*args, **kwargs).arguments
            output = next((found for n in names if (found := _value(given, n)) is not None), None)
            if output is None or _writes_nothing(given):
                return run(*args, **kwargs)
            with output_locked(output, stage):
                return run(*args, **kwargs)

        return guarded

    return decorate


def _value(given: Mapping[str, Any], name: str) -> Path | None:
    parameter, _, field = name.partition(".")
    value: Path | None = given.get(parameter)
    return attrgetter(field)(value) if field else value


def _writes_nothing(given: Mapping[str, Any]) -> bool:
    is_dry = any(isinstance(each, BatchOptions) and each.dry_run for each in given.values())
    return is_dry or ("TORCHELASTIC_RUN_ID" in os.environ and os.environ.get("RANK", "0") != "0")


@contextmanager
def output_locked(output: Path, stage: str) -> Iterator[None]:
    """Hold the lock of `output` for a run of `stage`, for as long as the context lasts.

    On a disk that is read-only or supports no locks, the run continues without a lock.

    Raises:
        OutputInUseError: another process holds the lock.
        SymgraspError: the output's folder is a file.
    """
    refuse_file_as_folder(output.parent)
    whole = real_path(output)
    made = _missing_parents(whole)
    lock = whole.with_name(f".{whole.name}.{stage}.lock")
    handle = None
    try:
        with suppress(OSError):  # the stage reports a folder that cannot be written
            whole.parent.mkdir(parents=True, exist_ok=True)
            handle = _opened_lock(lock, output, stage)
        yield
    finally:
        if handle is not None:
            with suppress(OSError):
                remove_temporary(lock)
            os.close(handle)
        for folder in made:
            with suppress(OSError):  # the run has filled it
                folder.rmdir()


def _missing_parents(path: Path) -> list[Path]:
    """Return the folders above `path` that do not exist, the innermost first."""
    return [folder for folder in path.parents if not folder.exists()]


def _opened_lock(lock: Path, output: Path, stage: str) -> int | None:
    """Return the open lock file; None on Windows, where there are no locks."""
    if sys.platform == "win32":
        return None
    while True:
        handle = _opened_file(lock)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_file_at(handle, lock):
                break  # else its holder has removed the file meanwhile
        except BlockingIOError as error:
            holder = _holder(handle)
            os.close(handle)
            raise OutputInUseError(output, stage, holder) from error
        except OSError:
            os.close(handle)
            raise
        os.close(handle)
    since = datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    record = {"process": os.getpid(), "host": socket.gethostname(), "since": since}
    with suppress(OSError):  # a file that a killed run of another user left keeps its record
        create_temporary(lock, lambda _: _write(handle, json.dumps(record)))
    return handle


def _opened_file(lock: Path) -> int:
    """Return the open lock file, made if it does not exist; another user's is open to read."""
    try:
        return os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    except PermissionError:  # a file that may only be read can be locked too
        return os.open(lock, os.O_RDONLY | os.O_NOFOLLOW)


def _is_file_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _holder(handle: int) -> dict[str, Any]:
    """Return the record that the holder of a lock file wrote into the file."""
    try:
        found = json.loads(os.read(handle, LONGEST_RECORD))
    except ValueError:  # not written yet
        return {}
    return found if isinstance(found, dict) else {}


def _write(handle: int, text: str) -> None:
    os.ftruncate(handle, 0)
    os.write(handle, text.encode())
