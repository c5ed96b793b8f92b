"""One run at a time on an output, and the name of the running process."""

import os
import re
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import pipelines
from pipelines.errors import SymgraspError
from pipelines.runtime.batch import BatchOptions
from pipelines.runtime.one_run import OutputInUseError, one_run_at_a_time, output_locked

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="nothing is locked there")
WRITES_NOTHING = {"doctor", "inspect_frames", "serve"}
HOLDER = """
import sys, time
from pathlib import Path
from pipelines.ending import end_on_signals
from pipelines.runtime.one_run import output_locked
end_on_signals()
with output_locked(Path(sys.argv[1]), "toy"):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def holder(tmp_path):
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "new" / "g.h5")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


@one_run_at_a_time("toy", "folder", "output")
def run(output, options=None, *, folder=None):
    return [each.name for each in (folder or output).parent.iterdir()]


def test_a_second_run_is_refused_with_the_process_that_holds_the_output(tmp_path, holder):
    found = (
        rf"g\.h5 is being written by another `symgrasp toy`, process {holder.pid} since 2\d{{3}}-"
    )
    with pytest.raises(OutputInUseError, match=found) as raised:
        run(tmp_path / "new" / ".." / "new" / "g.h5")
    assert raised.value.exit_code == 1
    with (
        output_locked(tmp_path / "new" / "g.h5", "another toy"),
        output_locked(tmp_path / "new" / "h.h5", "toy"),
    ):
        pass


def test_a_dry_run_and_the_other_processes_of_torchrun_need_no_lock(tmp_path, holder, monkeypatch):
    output = tmp_path / "new" / "g.h5"
    run(output, BatchOptions(dry_run=True))
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "1")
    monkeypatch.setenv("RANK", "1")
    run(output)
    monkeypatch.setenv("RANK", "0")
    with pytest.raises(OutputInUseError):
        run(output)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_ended_or_killed_holds_no_lock(tmp_path, holder, number):
    os.kill(holder.pid, number)
    holder.wait()
    assert run(tmp_path / "new" / "g.h5") == [".g.h5.toy.lock"]
    assert not (tmp_path / "new" / ".g.h5.toy.lock").exists()


def test_a_lock_leaves_no_file_and_no_folder_where_the_run_wrote_nothing(tmp_path):
    with output_locked(tmp_path / "a" / "b" / "g.h5", "toy"):
        assert (tmp_path / "a" / "b" / ".g.h5.toy.lock").exists()
    assert not list(tmp_path.iterdir())


def test_the_output_is_the_first_given_parameter(tmp_path):
    (tmp_path / "b").mkdir()
    assert run(tmp_path / "a" / "x", folder=tmp_path / "b" / "y") == [".y.toy.lock"]


def test_an_output_that_cannot_be_locked_is_written_without_a_lock():
    with output_locked(Path("/proc/none/g.h5"), "toy"):  # where nobody can make a folder
        pass
    with pytest.raises(SymgraspError, match="of unknown number"):
        raise OutputInUseError(Path("g.h5"), "toy", {})


def test_the_lock_of_another_user_which_may_only_be_read_is_respected(
    tmp_path, holder, monkeypatch
):
    system_open = os.open

    def opened(path, flags, *mode):
        if flags & os.O_RDWR:
            raise PermissionError(13, os.strerror(13), str(path))
        return system_open(path, flags, *mode)

    monkeypatch.setattr(os, "open", opened)
    output = tmp_path / "new" / "g.h5"
    with pytest.raises(OutputInUseError, match=f"process {holder.pid} since"):
        run(output)
    holder.kill()
    holder.wait()
    assert run(output) == [".g.h5.toy.lock"]
    assert not list(output.parent.iterdir())


@pytest.mark.parametrize(
    "stage", [p.stem for p in sorted(Path(pipelines.__file__).parent.glob("*.py"))]
)
def test_every_stage_that_writes_locks_its_output(stage):
    text = (Path(pipelines.__file__).parent / f"{stage}.py").read_text(encoding="utf-8")
    if stage not in WRITES_NOTHING and re.search(r"^def run\(", text, re.MULTILINE):
        run_of_stage = import_module(f"pipelines.{stage}").run
        assert hasattr(run_of_stage, "__wrapped__") or "with output_locked(" in text


def test_an_output_below_a_file_is_refused_in_one_sentence(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(SymgraspError, match="file is a file; name a folder"),
        output_locked(tmp_path / "file" / "new" / "g.h5", "toy"),
    ):
        pytest.fail("the run started")
