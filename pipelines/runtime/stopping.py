"""Reasons of a training to stop before its end: its time limit, SIGTERM, Ctrl-C."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType

from pipelines.errors import SymgraspError


class Reason(IntEnum):
    """Why to stop; of two reasons the larger counts."""

    NONE = 0
    TIME_LIMIT = 1
    SIGTERM = 2
    SIGINT = 3


class TrainingStopped(SymgraspError):  # noqa: N818 - nothing went wrong
    """A training that stopped before its end, on request, and left a checkpoint."""


class StopSignals:
    """Record of the signals to stop, which then do not end the process in mid-step."""

    def __init__(self) -> None:
        self.reason = Reason.NONE

    @contextmanager
    def heeded(self, *, patient: bool) -> Iterator[None]:
        """Record SIGTERM and Ctrl-C instead of ending, for as long as the context lasts.

        A second Ctrl-C ends the process at once, unless `patient`: torchrun sends each twice.
        """
        if threading.current_thread() is not threading.main_thread():
            yield  # only the main thread receives signals
            return

        def note(number: int, _frame: FrameType | None) -> None:
            if self.reason is Reason.SIGINT and number == signal.SIGINT and not patient:
                raise KeyboardInterrupt
            name = signal.Signals(number).name
            self.reason = max(self.reason, Reason[name])

        before = {each: signal.signal(each, note) for each in (signal.SIGTERM, signal.SIGINT)}
        try:
            yield
        finally:
            for each, handler in before.items():
                signal.signal(each, handler)
