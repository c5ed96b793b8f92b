"""Temporary files next to their final paths, and removal of those that killed processes left.

Their names contain the machine and the process: `.STEM.MACHINE-PROCESS-RANDOM.SUFFIX`.
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

NAME_KEPT = 40  # characters of a file's name in the name of its temporary file
NAME = re.compile(r"\..*\.([0-9a-f]{6})-(\d+)-[0-9a-f]{8}(\..*)?")
LONGEST_WRITE = 24 * 3600.0  # seconds after which another machine's file counts as left over
MACHINE_FACTS = ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid")


def new_temporary(path: Path, make: Callable[[Path], None]) -> Path:
    """Make a temporary file or folder next to `path`; first remove those of killed processes."""
    sweep(path.parent, os.getpid())
    mark = f"{_machine()}-{os.getpid()}-{secrets.token_hex(4)}"
    temporary = path.with_name(f".{path.stem[:NAME_KEPT]}.{mark}{path.suffix}")
    create_temporary(temporary, make)
    return temporary


@cache
def sweep(folder: Path, process: int) -> None:
    """Remove the temporary files in `folder` that no process writes, once per `process`."""
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
        except OSError:  # another process has removed it, or only another user may remove it
            continue


def is_running(process: int) -> bool:
    """Return whether a process of this machine has that number and has not ended."""
    if sys.platform == "win32":
        return True  # os.kill would end the process
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # another user's process
        return True
    try:  # a zombie has ended, but its parent has not read its exit code
        return ") Z " not in Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return True


@cache
def _machine() -> str:
    """Return an identifier of this machine and its process numbers; containers have their own."""
    facts = [socket.gethostname()]
    for path in MACHINE_FACTS:
        try:
            facts.append(str(os.stat(path).st_ino))  # noqa: PTH116 - follows links
            facts.append(Path(path).read_text(encoding="ascii"))
        except OSError:  # not Linux, or no file to read
            continue
    return hashlib.blake2b("\n".join(facts).encode(), digest_size=3).hexdigest()
