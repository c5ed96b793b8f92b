"""The README fits on few screens, and its Python lines print grasps."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MAX_LINES = 110


def python_lines() -> str:
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    return code


def test_the_readme_has_at_most_110_lines():
    assert len(README.splitlines()) <= MAX_LINES


def test_at_most_six_python_lines_print_grasps_of_a_bundled_frame(capsys):
    code = python_lines()
    assert len(code.splitlines()) <= 6
    exec(compile(code, "README.md", "exec"), {})  # the project's own text
    printed = capsys.readouterr().out
    assert len(re.findall(r"^0\.\d+ 0\.\d+ ", printed, re.MULTILINE)) == 3


@pytest.mark.parametrize("page", ["docs/reference/api.md", "symgrasp/__init__.py"])
def test_the_same_lines_are_shown_elsewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for line in python_lines().splitlines():
        assert line in text
