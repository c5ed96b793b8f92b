"""The script that makes all weights calls commands with existing options, in order."""

import itertools
import os
import shlex
import subprocess
from pathlib import Path

import pytest
from typer.main import get_command

from symgrasp_cli.app import app

SCRIPT = Path(__file__).parents[2] / "tools" / "make_weights.sh"
GROUP = get_command(app)


def calls(size, tmp_path, *method):
    """Return the command lines of a run whose commands do nothing."""
    log, stand_in = tmp_path / "calls.txt", tmp_path / "symgrasp"
    stand_in.write_text(f'#!/bin/sh\nprintf "%s\\n" "$*" >> {log}\n', encoding="utf-8")
    stand_in.chmod(0o755)
    environment = {**os.environ, "SYMGRASP": str(stand_in)}
    subprocess.run(
        ["sh", SCRIPT, "out", size, *method], env=environment, check=True, capture_output=True
    )
    return [shlex.split(line) for line in log.read_text(encoding="utf-8").splitlines()]


@pytest.mark.parametrize("method", ["default", "paper"])
@pytest.mark.parametrize("size", ["full", "tiny"])
def test_every_step_is_a_command_with_existing_options(size, method, tmp_path):
    for name, *arguments in calls(size, tmp_path, method):
        parameters = GROUP.commands[name].params
        known = {option for each in parameters for option in (*each.opts, *each.secondary_opts)}
        assert {each for each in arguments if each.startswith("--")} <= known, name


@pytest.mark.parametrize("size", ["full", "tiny"])
def test_each_file_is_written_before_it_is_read(size, tmp_path):
    written = set()
    for _, *arguments in calls(size, tmp_path):
        pairs = dict(itertools.pairwise(arguments))
        read = {value for option, value in pairs.items() if option not in {"--out"}}
        weights = {value for value in read if value.endswith(".safetensors")}
        assert weights - {pairs.get("--out")} <= written
        written.add(pairs.get("--out"))
    names = ("detector", "network", "axis_critic", "plane_critic", "grasp_critic")
    assert {f"out/{name}.safetensors" for name in names} <= written


def test_the_papers_networks_are_trained_by_the_preset_and_need_no_critic(tmp_path):
    trained = [
        line for line in calls("full", tmp_path, "paper") if "train" in line[0] or "det" in line[0]
    ]
    assert [line[0] for line in trained] == ["finetune-detector", "train"]
    assert all(line[line.index("--preset") + 1] == "paper" for line in trained)


def test_another_size_is_wrong_usage(tmp_path):
    made = subprocess.run(
        ["sh", SCRIPT, "out", "huge"], capture_output=True, text=True, check=False
    )
    assert (made.returncode, made.stdout) == (2, "")
    assert "it must be full, small or tiny" in made.stderr
