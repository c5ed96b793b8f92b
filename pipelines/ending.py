"""End of a process: by a signal or with its parent; temporary files are removed.

An exception from a handler would be swallowed where a library catches everything (trimesh does
around its imports) and would leave modules half imported. So a signal ends the process from within
its handler, unless a stage delays that (`runtime/stopping.py`). Only the standard library is
imported here: the command line sets its handlers before anything else is loaded.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn

SIGNALS = ("SIGTERM", "SIGINT", "SIGHUP")
POLL = 0.5  # seconds between two checks that the parent is running
LONGEST_CREATION = 2.0  # seconds to wait for a thread that creates a temporary file
# Silences the warnings of child processes that free resources left by this process.
NO_WORD_OF_LEAKS = "ignore:resource_tracker:UserWarning"
SHARED_MEMORY = Path("/dev/shm")
SHOW_CURSOR = "\x1b[?25h"  # a progress bar hides it

_farewell = "the same command continues from here"
_put_off: list[int] | None = None  # signals that came while a worker starts
_temporary: set[Path] = set()
_lock = threading.RLock()  # a handler may interrupt the main thread while it holds it


def create_temporary(path: Path, make: Callable[[Path], None]) -> None:
    """Make the file or folder `path`; it is removed when this process ends."""
    with _lock:
        _temporary.add(path)
        make(path)


def remove_temporary(path: Path) -> None:
    """Remove the file or folder `path`, if it still exists under that name."""
    if path.is_dir() and not path.is_symlink():
        import shutil  # noqa: PLC0415 - not needed at the start

        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
    _temporary.discard(path)


def end(code: int) -> NoReturn:
    """End this process at once with `code`; its temporary files are removed."""
    _lock.acquire(timeout=LONGEST_CREATION)  # never released: nothing is created any more
    for path in list(_temporary):
        with suppress(OSError):  # the next run removes it
            remove_temporary(path)
    remove_joblib_folders(lambda process: process == os.getpid())
    os._exit(code)


def remove_joblib_folders(is_meant: Callable[[int], bool]) -> None:
    """Remove joblib's empty folders in shared memory, of the processes that `is_meant` accepts.

    joblib makes a folder before it registers the folder with the tracker that would remove it.
    """
    for folder in SHARED_MEMORY.glob("joblib_memmapping_folder_*"):
        number = folder.name.split("_")[3]
        if number.isdecimal() and is_meant(int(number)):
            with suppress(OSError):  # in use, or another user's
                folder.rmdir()


def end_on_signals() -> None:
    """Let SIGTERM, Ctrl-C and a closed terminal end this process at once, with code 128 + number.

    A closed terminal does not end it under `nohup`.
    """
    filters = [os.environ.get("PYTHONWARNINGS"), NO_WORD_OF_LEAKS]
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, filters))
    for name in SIGNALS:
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        is_nohup = name == "SIGHUP" and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        if number is not None and not is_nohup:
            signal.signal(number, end_by_signal)


def set_farewell(sentence: str) -> None:
    """Set the sentence that the end by a signal prints, for a command that cannot be resumed."""
    global _farewell  # noqa: PLW0603 - one process has one end
    _farewell = sentence


@contextmanager
def signal_handlers_kept() -> Iterator[None]:
    """Restore the handlers of the signals that end this process after a library replaced them."""
    numbers = [getattr(signal, name) for name in SIGNALS if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            for number, handler in before.items():
                signal.signal(number, handler)


def end_by_signal(number: int, _frame: object = None) -> None:
    """End this process at once with the exit code of a signal, and print a sentence.

    A process that starts a worker goes on until the worker has started.
    """
    waiting = _put_off  # read once: another thread may end the context meanwhile
    if waiting is not None:
        waiting.append(number)
        return
    if os.environ.get("RANK", "0") == "0":  # of torchrun's processes only the first prints
        shown = SHOW_CURSOR if os.isatty(2) else ""
        name = signal.Signals(number).name
        _say(f"{shown}error: stopped by {name}; {_farewell}\n")
    end(128 + number)


def _say(text: str) -> None:
    try:
        os.write(2, text.encode())  # not through a stream, which may be in the middle of a write
    except OSError:  # nobody reads it
        return


@contextmanager
def signals_put_off() -> Iterator[None]:
    """Put off the end by a signal until the context ends, in which workers start.

    A worker whose parent ends before it has got its task prints a traceback. SIGINT is blocked in
    the workers until they begin.
    """
    global _put_off  # noqa: PLW0603 - one process has one end
    if sys.platform == "win32":
        yield
        return
    from multiprocessing import resource_tracker  # noqa: PLC0415 - not needed at the start

    resource_tracker.ensure_running()  # its later start would unblock SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    _put_off = came = list[int]()
    try:
        yield
    finally:
        _put_off = None
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if came:
            end_by_signal(came[0])


def begin_worker(parent: int) -> None:
    """Let this worker process end with `parent`, and leave Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, _frame: end(128 + number))
    if sys.platform != "win32":  # `signals_put_off` has blocked SIGINT
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    end_with_parent(parent)


def end_with_parent(parent: int) -> None:
    """Let this process end soon after process `parent`, which started it, has ended.

    A killed parent cannot end its children, which would hold their memory for minutes. Windows
    keeps the parent's process id, so children do not end by themselves there.
    """
    if sys.platform == "win32":
        return

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(POLL)
        end(1)

    threading.Thread(target=watch, daemon=True).start()


if hasattr(os, "register_at_fork"):  # the temporary files belong to the parent
    os.register_at_fork(after_in_child=_temporary.clear)
