"""Progress of a batch on stderr: a bar on a terminal, otherwise a line every half minute."""

import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TextIO, TypeVar

Item = TypeVar("Item")
LINE_SECONDS = 30.0  # between two lines


def with_progress(items: Iterable[Item], stage: str, total: int) -> Iterator[Item]:
    """Yield `items`; show on stderr the number of `total` items done, and the time left.

    Args:
        items: results, each available when it is done.
        stage: name of the bar or of the lines.
        total: number of items.
    """
    if sys.stderr.isatty():
        from rich.console import Console  # noqa: PLC0415 - slow to import
        from rich.progress import track  # noqa: PLC0415

        yield from track(items, stage, total=total, console=Console(stderr=True))
        return
    with _lines(stage, total, sys.stderr) as count:
        for item in items:
            count.done += 1
            yield item


def progress_line(stage: str, done: int, total: int, seconds: float) -> str:
    """Return a line of progress after `seconds`: number of items done, total, time left."""
    if not done:
        return f"{stage}: 0 of {total} done"
    left = seconds / done * (total - done)
    return f"{stage}: {done} of {total} done, {duration(left)} left"


def duration(seconds: float) -> str:
    """Return a duration as h:mm:ss, without hours where there are none."""
    whole = round(max(seconds, 0.0))
    hours, rest = divmod(whole, 3600)
    text = f"{rest // 60:02d}:{rest % 60:02d}" if hours else f"{rest // 60}:{rest % 60:02d}"
    return f"{hours}:{text}" if hours else text


class _Count:
    """The number of items that are done."""

    done = 0


@contextmanager
def _lines(stage: str, total: int, stream: TextIO) -> Iterator[_Count]:
    """Write lines of progress to `stream` from a thread, as an item may take longer."""
    count, ended, started = _Count(), threading.Event(), time.monotonic()

    def write() -> None:
        while not ended.wait(LINE_SECONDS):
            stream.write(progress_line(stage, count.done, total, time.monotonic() - started) + "\n")
            stream.flush()

    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    try:
        yield count
    finally:
        ended.set()
        thread.join()
