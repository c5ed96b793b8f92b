"""Reasons for a training to stop before its end: its time limit, SIGTERM, Ctrl-C."""

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType
from typing import Any

from pipelines.errors import SymgraspError

STOP_SIGNALS = (signal.SIGTERM, signal.SIGINT)
Handler = Callable[[int, FrameType | None], Any] | int | signal.Handlers | None


class StopReason(IntEnum):
    """Reason to stop; of two reasons the larger value counts."""

    NONE = 0
    TIME_LIMIT = 1
    SIGTERM = 2
    SIGINT = 3


class TrainingStopped(SymgraspError):  # noqa: N818 - nothing went wrong
    """A training that stopped before its end, on request, and left a checkpoint.

    `exit_code`: 128 + the signal's number, as in shells.
    """

    def __init__(self, reason: StopReason, sentence: str) -> None:
        super().__init__(f"stopped by {reason.name} {sentence}")
        self.exit_code = 128 + signal.Signals[reason.name]


class StopSignals:
    """Record of the signals to stop, which so do not end the process within a step."""

    def __init__(self) -> None:
        self.reason = StopReason.NONE
        self._before: dict[signal.Signals, Handler] = {}  # the earlier handlers

    @contextmanager
    def recorded(self, *, expects_repeats: bool) -> Iterator[None]:
        """Record SIGTERM and Ctrl-C instead of ending, for as long as the context lasts.

        A second signal ends the process at once, unless `expects_repeats`: torchrun sends two.
        """
        if threading.current_thread() is not threading.main_thread():
            yield  # only the main thread receives signals
            return

        def note(number: int, _frame: FrameType | None) -> None:
            if self.reason is not StopReason.NONE and not expects_repeats:
                signal.signal(number, self._before[signal.Signals(number)])
                signal.raise_signal(number)
            name = signal.Signals(number).name
            self.reason = max(self.reason, StopReason[name])

        self._before = {each: signal.getsignal(each) for each in STOP_SIGNALS}
        with _handled_by(dict.fromkeys(STOP_SIGNALS, note)):
            yield
        self._before = {}

    @contextmanager
    def ending_at_once(self) -> Iterator[None]:
        """Let a signal end the process at once, inside `recorded`, while nothing can be lost."""
        with _handled_by(self._before):
            yield


@contextmanager
def _handled_by(handlers: Mapping[signal.Signals, Handler]) -> Iterator[None]:
    before = {each: signal.signal(each, handler) for each, handler in handlers.items()}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
