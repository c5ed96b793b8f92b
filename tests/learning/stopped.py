"""Trainings that stop after some steps, as their time limit would stop them."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from pipelines.learning.loop.loop import TrainingRun
from pipelines.runtime.stopping import Reason


@contextmanager
def stopped_after(steps: int) -> Iterator[None]:
    """Let trainings meanwhile stop when they have made `steps` steps."""
    why_stop = TrainingRun._why_stop

    def stopping(run: TrainingRun) -> Reason:
        return Reason.TIME_LIMIT if run.progress.total_steps >= steps else why_stop(run)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TrainingRun, "_why_stop", stopping)
        yield
