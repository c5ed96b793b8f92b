"""Temporary files beside the files that they become, and those that killed processes left.

Their names say which machine and process they are of: `.STEM.MACHINE-PROCESS-RANDOM.SUFFIX`.
"""

import hashlib
import os
import re
import secrets
import socket
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

from pipelines.ending import create_temporary, remove_temporary

NAME_KEPT = 40  # characters of a file's name in that of its temporary file
NAME = re.compile(r"\..*\.([0-9a-f]{6})-(\d+)-[0-9a-f]{8}(\..*)?")
LONGEST_WRITE = 24 * 3600.0  # seconds after which another machine does not write it any more
MACHINE_FACTS = ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid")


def new_temporary(path: Path, make: Callable[[Path], None]) -> Path:
    """Make a temporary file or folder beside `path`; first remove those of killed processes."""
    sweep(path.parent, os.getpid())
    mark = f"{_machine()}-{os.getpid()}-{secrets.token_hex(4)}"
    temporary = path.with_name(f".{path.stem[:NAME_KEPT]}.{mark}{path.suffix}")
    create_temporary(temporary, make)
    return temporary


@cache
def sweep(folder: Path, process: int) -> None:
    """Remove the temporary files in `folder` that nobody writes; once a `process`."""
    for entry in os.scandir(folder):
        found = NAME.fullmatch(entry.name)
        if found is None:
            continue
        try:
            if found[1] == _machine():
                is_left = not is_running(int(found[2]))
            else:
                is_left = time.time() - entry.stat().st_mtime > LONGEST_WRITE
            if is_left:
                remove_temporary(Path(entry.path))
        except OSError:  # another process has removed it, or may alone
            continue


def is_running(process: int) -> bool:
    """Return whether a process of this machine has that number and has not ended."""
    if sys.platform == "win32":
        return True  # the question would end it
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # another user's
        return True
    try:  # one that has ended and that nobody asked for its exit code
        return ") Z " not in Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return True


@cache
def _machine() -> str:
    """Return a mark of this machine and its numbers of processes: containers have their own."""
    facts = [socket.gethostname()]
    for path in MACHINE_FACTS:
        try:
            facts.append(str(os.stat(path).st_ino))  # noqa: PTH116 - of what a link leads to
            facts.append(Path(path).read_text(encoding="ascii"))
        except OSError:  # not Linux, or no file to read
            continue
    return hashlib.blake2b("\n".join(facts).encode(), digest_size=3).hexdigest()
