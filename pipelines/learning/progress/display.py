"""Progress of a running training: a bar with the time left on a terminal, else lines."""

import logging
import time
from collections.abc import Mapping
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from pipelines.runtime.progress import duration

log = logging.getLogger(__name__)


class Display:
    """Shows the progress of a training on stderr, unless `shown` is False.

    A bar if `bar` is True; otherwise a line at most every `seconds`.
    """

    def __init__(self, *, shown: bool, bar: bool, seconds: float) -> None:
        self.shown, self.seconds, self._spoke = shown, seconds, time.monotonic()
        self._task: TaskID | None = None
        self._bar: Progress | None = None
        if shown and bar:
            columns = (
                TextColumn("{task.description}"),
                BarColumn(bar_width=None),
                TextColumn("{task.completed}/{task.total}  {task.fields[losses]}"),
                TextColumn("{task.fields[left]} left"),
            )
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_error: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def step(
        self, epoch: str, done: int, total: int, losses: Mapping[str, float], left: float
    ) -> None:
        """Show that `done` of `total` steps of an epoch are done; `left` seconds remain."""
        if not self.shown:
            return
        if self._bar is not None:
            if self._task is None:
                self._task = self._bar.add_task(epoch, losses="", left="")
            self._bar.update(
                self._task,
                description=f"epoch {epoch}",
                completed=done,
                total=total,
                losses=f"loss {losses['total']:.3f}",
                left=duration(left),
            )
        elif time.monotonic() - self._spoke > self.seconds:
            self._spoke = time.monotonic()
            terms = ", ".join(f"{name} {value:.3f}" for name, value in losses.items())
            log.info("epoch %s, step %d/%d, %s, %s left", epoch, done, total, terms, duration(left))

    def say(self, text: str) -> None:
        """Show a line that remains on the terminal."""
        if self._bar is not None:
            self._bar.console.print(text, highlight=False, markup=False)
        elif self.shown:
            log.info("%s", text)
