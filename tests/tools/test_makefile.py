"""Targets of the Makefile, with stand-ins for the programs: what is kept and what is made again."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

MAKEFILE = Path(__file__).parents[2] / "Makefile"
EARLIER = 1_000_000_000.0  # seconds; any time before the test
SYMGRASP = """#!/bin/sh
for word in "$@"; do [ "$last" != --out ] || out=$word; last=$word; done
[ "$1" != infer ] || { ls "$out.parts" 2>/dev/null | sed "s/^/part /" >> calls; }
echo "$1" >> calls
if [ "$1" = infer ] && [ -e killed ]; then
    mkdir -p "$out.parts"; touch "$out.parts/frame.h5"
    exit 1
fi
[ -n "$out" ] || { mkdir -p "$2"; exit; }
touch "$out" && rm -rf "$out.parts"
"""
PYTHON = """#!/bin/sh
for folder in "$@"; do :; done
echo "$@" >> created
mkdir -p "$folder/bin" && cp environment "$folder/bin/python"
[ ! -e failing ] || exit 1
touch "$folder/pip" "$folder/bin/activate"
"""
ENVIRONMENT = """#!/bin/sh
[ "$2" != ensurepip ] || touch .venv/pip
[ -e .venv/pip ]
"""
SOURCES = ("infer.py", "grasping/a.py", "grasping/symmetries/b.py", "grippers/rg2.toml")

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def script(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)
    return path


def make(folder, *words):
    """Run make in `folder`; return its exit status."""
    # Under `make test`, the environment has the options of that make.
    outer = {"MAKEFLAGS", "MFLAGS", "MAKELEVEL", "MAKEOVERRIDES"}
    environment = {name: value for name, value in os.environ.items() if name not in outer}
    command = ["make", "--file", str(MAKEFILE), *words]
    return subprocess.run(
        command, cwd=folder, env=environment, check=False, capture_output=True
    ).returncode


@pytest.fixture
def installed(tmp_path):
    """A folder with sources and an installed environment."""
    for name in SOURCES:
        source = tmp_path / "pipelines" / name
        source.parent.mkdir(parents=True, exist_ok=True)
        source.touch()
        os.utime(source, (EARLIER, EARLIER))
    for name in ("pyproject.toml", ".venv/created", ".venv/installed", ".venv/developed"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def evaluated(folder):
    """Run `make eval` with the stand-in; return its calls, after the parts that infer found."""
    script(folder / "symgrasp", SYMGRASP)
    (folder / "calls").write_text("", encoding="utf-8")
    make(folder, "eval", "SYMGRASP=./symgrasp")
    return (folder / "calls").read_text(encoding="utf-8").splitlines()


def test_a_finished_evaluation_is_only_printed_again(installed):
    assert evaluated(installed)[-4:] == ["infer", "simulate", "evaluate", "evaluate"]
    assert evaluated(installed) == ["evaluate"]


@pytest.mark.parametrize("name", SOURCES)
def test_a_changed_source_at_any_depth_makes_all_figures_again(name, installed):
    evaluated(installed)
    (installed / "pipelines" / name).touch()
    assert evaluated(installed) == ["infer", "simulate", "evaluate", "evaluate"]


@pytest.mark.parametrize("is_changed", [False, True])
def test_a_killed_infer_resumes_unless_a_source_has_changed(is_changed, installed):
    (installed / "killed").touch()
    assert evaluated(installed)[-1] == "infer"
    (installed / "killed").unlink()
    if is_changed:
        (installed / "pipelines" / SOURCES[2]).touch()
    found = [] if is_changed else ["part frame.h5"]
    assert evaluated(installed) == [*found, "infer", "simulate", "evaluate", "evaluate"]


def test_a_source_that_changed_during_infer_makes_all_figures_again(installed):
    evaluated(installed)
    made = [path for path in (installed / "build/eval").iterdir() if path.suffix != ".made"]
    assert {path.name for path in made} == {"root", "grasps.h5", "success.json", "report.json"}
    (installed / "pipelines" / SOURCES[0]).touch()
    for path in made:
        path.touch()
    assert evaluated(installed) == ["infer", "simulate", "evaluate", "evaluate"]


@pytest.fixture
def bare(tmp_path):
    """A folder without an environment, and the interpreter that creates environments."""
    (tmp_path / "pyproject.toml").touch()
    script(tmp_path / "environment", ENVIRONMENT)
    script(tmp_path / "python", PYTHON)
    return tmp_path


def creations(folder):
    """Return how often `make` has created an environment in `folder`."""
    created = folder / "created"
    return len(created.read_text(encoding="utf-8").splitlines()) if created.exists() else 0


def test_a_failed_creation_of_the_environment_is_repeated_and_a_finished_one_is_not(bare):
    (bare / "failing").touch()
    assert make(bare, ".venv/installed", "PYTHON=./python") == 2
    (bare / "failing").unlink()
    assert make(bare, ".venv/installed", "PYTHON=./python") == 0
    assert creations(bare) == 2
    (bare / "pyproject.toml").touch()
    assert make(bare, ".venv/installed", "PYTHON=./python") == 0
    assert creations(bare) == 2


@pytest.mark.parametrize("there", ["pip", "bin/activate"])
def test_an_environment_that_make_did_not_create_is_kept(there, bare):
    script(bare / ".venv/bin/python", ENVIRONMENT)
    (bare / ".venv" / there).touch()
    assert make(bare, ".venv/installed", "PYTHON=./python") == 0
    assert creations(bare) == 0
    assert (bare / ".venv/pip").exists()
