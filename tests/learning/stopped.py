"""Trainings that stop after some steps, as by their time limit."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from pipelines.learning.loop.loop import TrainingRun
from pipelines.runtime.stopping import StopReason


@contextmanager
def stopped_after(steps: int) -> Iterator[None]:
    """Stop trainings in this context after `steps` steps."""
    why_stop = TrainingRun._why_stop

    def stopping(run: TrainingRun) -> StopReason:
        return StopReason.TIME_LIMIT if run.progress.total_steps >= steps else why_stop(run)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TrainingRun, "_why_stop", stopping)
        yield
