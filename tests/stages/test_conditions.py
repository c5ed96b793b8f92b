"""Outputs are the same under all conditions, and no command opens a connection.

`python -m tests.stages.conditions --help` tries all commands.
"""

import subprocess
import sys

import pytest

from tests.stages.conditions import CONDITIONS, differing, written
from tests.stages.interruption import COMMANDS, ROOT, write_inputs

# An audit hook that ends the process where Python code connects to another machine.
GUARDED = """
import os, sys
def refuse(event, arguments):
    if event in {"socket.connect", "socket.sendto"} and isinstance(arguments[1], tuple):
        os.write(2, f"connects to {arguments[1]}".encode())
        os._exit(77)
sys.addaudithook(refuse)
from symgrasp_cli.main import main
main()
"""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return write_inputs(tmp_path_factory.mktemp("inputs"))


def test_hash_seed_time_zone_locale_threads_and_workers_change_no_byte(inputs):
    reference = written("pack", inputs, {})
    assert reference
    all_at_once = {name: value for each in CONDITIONS.values() for name, value in each.items()}
    assert differing(reference, written("pack", inputs, all_at_once | {"workers": "1"})) == ""


def test_infer_connects_to_no_other_machine(inputs, tmp_path):
    words = COMMANDS["infer"].format(root=inputs / "root", out=tmp_path).split()
    done = subprocess.run(
        [sys.executable, "-c", GUARDED, "infer", *words, "--workers", "1"],
        cwd=ROOT, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "g.h5").exists()


def test_the_audit_hook_ends_a_process_that_connects():
    code = GUARDED.replace(
        "from symgrasp_cli.main import main\nmain()",
        "import socket; socket.socket().connect(('192.0.2.1', 80))",
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 77
    assert "192.0.2.1" in done.stderr
