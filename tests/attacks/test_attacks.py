"""Attacks through the command line: each ends in time and in bounds, with a sentence.

A few cheap ones by default; `SYMGRASP_ATTACKS=N` runs N, on every input of every command.
"""

import os
import time
from pathlib import Path

import pytest

from tests.attacks import trial
from tests.attacks.campaign import attacked, made_world, unharmed
from tests.attacks.services import POST

FEW = 20


pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="attacks are made in forks")


WANTED = int(os.environ.get("SYMGRASP_ATTACKS", "0"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a world of right inputs, without costly ones by default."""
    made = tmp_path_factory.mktemp("attacks")
    made_world(made, small=not WANTED)
    return made


def test_no_attack_ends_in_a_traceback_a_hang_a_crash_or_a_half_written_file(folder: Path) -> None:
    made = made_world(folder)
    outcomes = attacked(made, folder, WANTED or FEW, small=not WANTED)
    assert not [outcome for outcome in outcomes if outcome.fault]


def test_every_attacked_command_works_on_its_right_inputs(folder: Path) -> None:
    outcomes = list(unharmed(made_world(folder), folder, small=not WANTED))
    assert not [outcome for outcome in outcomes if outcome.fault]
    assert len(outcomes) > FEW


def test_a_command_that_stands_still_counts_as_a_hang(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(trial, "post", lambda _path: time.sleep(600))
    monkeypatch.setattr(trial, "SECONDS", 0.1)
    monkeypatch.setattr(trial, "STILL", 0.1)
    ended = trial.run(tmp_path, (POST, "x"))
    assert (ended.is_hang, ended.code) == (True, -9)
