"""End of a ray cluster after its owner was killed: ray's agents would run on for a minute.

`ended_with_owner` starts this file as a process that waits for the end of its standard input. The
words `SHUT_DOWN` before that end mean that the cluster was shut down in order.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

SHUT_DOWN = b"shut down"
PROCESSES = Path("/proc")


@contextmanager
def ended_with_owner(processes: list[int]) -> Iterator[None]:
    """Let `processes` and their descendants end as soon as this process does, even if killed."""
    if not PROCESSES.is_dir():  # not Linux: ray ends them by itself, later
        yield
        return
    command = [sys.executable, __file__, *map(str, processes)]
    # In a new session, since only the owner handles Ctrl-C on a terminal.
    with subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True) as watch:
        try:
            yield
        finally:
            with suppress(BrokenPipeError):
                watch.communicate(SHUT_DOWN)


def descendants(processes: set[int]) -> set[int]:
    """Return the running ones of `processes` and of their descendants."""
    parents = {}
    for folder in PROCESSES.glob("[0-9]*"):
        with suppress(OSError, IndexError, ValueError):
            # The name in parentheses may contain anything.
            words = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[int(folder.name)] = int(words[1])
    found = set(processes)
    while more := {each for each, parent in parents.items() if parent in found} - found:
        found |= more
    return found & set(parents)


def main() -> None:
    """Wait for the owner's end; kill the processes of the command line unless it was in order."""
    # Descendants are found now: after the owner's end some have another parent.
    known = descendants({int(each) for each in sys.argv[1:]})
    if sys.stdin.buffer.read() == SHUT_DOWN:
        return
    for process in descendants(known):
        with suppress(OSError):
            os.kill(process, signal.SIGKILL)


if __name__ == "__main__":
    main()
