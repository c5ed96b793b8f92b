"""Ends of processes: signals from the first instruction on, parents that are killed."""

import os
import signal
import subprocess
import sys
import time

import pytest

from pipelines import ending
from pipelines.storage import temporary
from pipelines.storage.files import write_text

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no such signals")
START = "import sys; from symgrasp_cli.main import main; "
SWALLOWED = """
import os, signal, sys
from pathlib import Path
from pipelines.ending import end_on_signals
from pipelines.storage.files import atomic_folder, atomic_path
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup has it ignored
end_on_signals()
with atomic_path(Path(sys.argv[1]) / "a.txt"), atomic_folder(Path(sys.argv[1]) / "b") as folder:
    (folder / "c").write_text("c")
    try:
        os.kill(os.getpid(), int(sys.argv[2]))
    except BaseException:
        pass
    os._exit(0)
"""
CHILD = """
import os, sys, time
from pipelines.ending import begin_worker
begin_worker(os.getppid())
print(os.getpid(), flush=True)
time.sleep(600)
"""
PARENT = """
import subprocess, sys, time
subprocess.Popen([sys.executable, "-c", sys.argv[1]])
time.sleep(600)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_the_process_where_a_library_catches_everything(tmp_path, number):
    command = [sys.executable, "-c", SWALLOWED, str(tmp_path), str(int(number))]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 128 + number
    assert run.stderr == f"error: stopped by {number.name}; the same command continues from here\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_are_handled_before_the_commands_are_imported(number):
    # The first import after this sends the signal.
    hook = (
        "import os; from types import SimpleNamespace; "
        f"find = lambda name, *rest: os.kill(os.getpid(), {int(number)}); "
        "sys.meta_path.insert(0, SimpleNamespace(find_spec=find)); main()"
    )
    run = subprocess.run([sys.executable, "-c", START + hook], capture_output=True, check=False)
    assert run.returncode == 128 + number
    assert b"Traceback" not in run.stderr


def test_a_worker_ends_with_a_parent_that_is_killed_and_leaves_interrupts_to_it():
    command = [sys.executable, "-c", PARENT, CHILD]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        worker = int(parent.stdout.readline())
        os.kill(worker, signal.SIGINT)
        time.sleep(0.2)
        assert temporary.is_running(worker)
        parent.kill()
    for _ in range(600):  # a minute, for a busy machine
        if not temporary.is_running(worker):
            break
        time.sleep(0.1)
    assert not temporary.is_running(worker)


def test_temporary_files_of_killed_processes_are_removed_and_others_stay(tmp_path):
    with subprocess.Popen([sys.executable, "-c", "pass"]) as ended:
        ended.wait()
    machine, old = temporary._machine(), time.time() - 2 * temporary.LONGEST_WRITE
    left = tmp_path / f".g.{machine}-{ended.pid}-0123abcd.h5"
    folder = tmp_path / f".b.{machine}-{ended.pid}-0123abcd"
    of_now = tmp_path / f".g.{machine}-{os.getppid()}-0123abcd.h5"
    elsewhere = tmp_path / ".g.ffffff-1-0123abcd.h5"
    elsewhere_long_ago = tmp_path / ".g.ffffff-1-0123abce.h5"
    others = tmp_path / ".hidden.h5"
    folder.mkdir()
    for path in (left, folder / "c", of_now, elsewhere, elsewhere_long_ago, others):
        path.touch()
    os.utime(elsewhere_long_ago, (old, old))
    write_text(tmp_path / "g.txt", "g")
    assert set(tmp_path.iterdir()) == {of_now, elsewhere, others, tmp_path / "g.txt"}


def test_empty_folders_of_joblib_are_removed_and_others_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(ending, "SHARED_MEMORY", tmp_path)
    left, full, of_others, strange = (
        tmp_path / f"joblib_memmapping_folder_{name}" for name in ("1_a", "1_b", "2_a", "x_a")
    )
    for folder in (left, full / "array", of_others, strange):
        folder.mkdir(parents=True)
    ending.remove_joblib_folders(lambda process: process == 1)
    assert set(tmp_path.iterdir()) == {full, of_others, strange}


def test_handlers_that_a_library_sets_are_undone():
    before = signal.getsignal(signal.SIGTERM)
    with ending.signal_handlers_kept():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_command_ends_without_a_last_garbage_collection():
    watch = "import atexit, gc; atexit.register(lambda: print('frozen', gc.get_freeze_count())); "
    ended = subprocess.run(
        [sys.executable, "-c", f"{watch}{START}main()", "config", "--help"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0
    assert int(ended.stdout.split("frozen ")[1]) > 0


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_closed_standard_streams_are_open_for_workers_and_no_file_takes_their_place(
    tmp_path, closed
):
    """A service manager or another program may close them."""
    look = (
        "import os, subprocess, sys; from symgrasp_cli.main import open_closed_streams; "
        f"[os.close(number) for number in {closed}]; "
        "names = ('stdin', 'stdout', 'stderr'); "
        f"[setattr(sys, names[number], None) for number in {closed}]; "  # as Python starts then
        "open_closed_streams(); "
        "seen = subprocess.run([sys.executable, '-c', 'import sys; assert all((sys.stdin, "
        "sys.stdout, sys.stderr))'], check=False).returncode; "
        "sys.stdout.flush(); sys.stderr.flush(); "
        "file = open(sys.argv[1], 'w'); file.write(f'{seen} {file.fileno() > 2}'); file.close()"
    )
    found = tmp_path / "found"
    subprocess.run([sys.executable, "-c", look, str(found)], check=False, timeout=60)
    assert found.read_text() == "0 True"
