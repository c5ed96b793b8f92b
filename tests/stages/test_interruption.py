"""Signals at random moments: `SYMGRASP_INTERRUPTIONS=100` makes 100 of each kind.

`python -m tests.stages.interruption --help` tries all long stages.
"""

import os
import random
import signal
import sys

import pytest

from tests.stages.interruption import Stage, trial, write_inputs

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no such signals")
TRIALS = int(os.environ.get("SYMGRASP_INTERRUPTIONS", "1"))


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    inputs = write_inputs(tmp_path_factory.mktemp("inputs"))
    return Stage("infer", inputs).refer()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
@pytest.mark.parametrize("seed", range(TRIALS))
def test_a_run_interrupted_at_any_moment_ends_and_resumes_to_the_same_bytes(stage, number, seed):
    moment = random.Random(seed).uniform(0.2, 0.9) * stage.seconds
    again = number == signal.SIGKILL
    assert not trial(stage, number, moment, again=again).wrong
