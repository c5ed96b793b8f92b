"""Attacks through the command line: each ends in time and in bounds, with a sentence.

A few cheap ones by default; `SYMGRASP_ATTACKS=N` runs N, on every input of every command.
"""

import os
from pathlib import Path

import pytest

from tests.attacks.campaign import attacked, made_world

FEW = 20


@pytest.mark.skipif(not hasattr(os, "fork"), reason="attacks are made in forks")
def test_no_attack_ends_in_a_traceback_a_hang_a_crash_or_a_file_half_written(
    tmp_path: Path,
) -> None:
    wanted = int(os.environ.get("SYMGRASP_ATTACKS", "0"))
    world = made_world(tmp_path, small=not wanted)
    faults = [
        outcome
        for outcome in attacked(world, tmp_path, wanted or FEW, small=not wanted)
        if outcome.fault
    ]
    assert not faults
