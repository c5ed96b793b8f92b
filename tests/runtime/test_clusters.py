"""Batches on clusters: the same work in other processes, the same bytes whatever their number."""

import logging
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import psutil
import pytest
from joblib import delayed
from joblib.externals.loky import process_executor

from pipelines.configs import InferConfig
from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.runtime.batch import BatchOptions, WorkItem, run_batch
from pipelines.runtime.clusters import HUGE_PAGES, TUNABLES, end_workers, workers_of
from pipelines.storage.files import read_json, write_json
from pipelines.storage.provenance import make_stamp

QUIET = BatchOptions(progress=False)
ROOT = Path(__file__).resolve().parents[2]
PLANAR = InferConfig(regions="geometric", method="planar")
MODULES = {"dask": "distributed", "ray": "ray"}

# Warnings of clusters while they start and end do not matter here.
pytestmark = pytest.mark.filterwarnings("default")


def dask_of(workers):
    pytest.importorskip("distributed", reason="the extra `dask` is not installed")
    return replace(QUIET, workers=workers, backend="dask")


def ray_of(workers):
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    return replace(QUIET, workers=workers, backend="ray")


def items(folder, names):
    return [WorkItem(name, folder / f"{name}.json", make_stamp("toy", {})) for name in names]


def write_process(item):
    if item.name == "bad":
        raise SymgraspError("bad is bad; good would be right")
    gpus = os.environ.get("CUDA_VISIBLE_DEVICES", "all")
    content = {"provenance": item.stamp.as_json(), "process": os.getpid(), "gpus": gpus}
    content |= {"tunables": os.environ.get(TUNABLES)}
    content |= {"leak": str(process_executor._MAX_MEMORY_LEAK_SIZE)}
    write_json(item.target, content)


def assert_others_do_all_but_the_bad_item(options, folder):
    work = items(folder, ["a", "bad", "b"])
    report = run_batch("toy", work, write_process, options)
    assert report.done == ["a", "b"]
    assert report.failed == {"bad": "bad is bad; good would be right"}
    assert os.getpid() not in {read_json(folder / f"{name}.json")["process"] for name in "ab"}


def test_dasks_workers_are_other_processes_and_a_bad_item_fails_alone(tmp_path):
    assert_others_do_all_but_the_bad_item(dask_of(2), tmp_path)


@pytest.fixture(scope="module")
def batches(tmp_path_factory):
    """Reports of two batches, the user's tunables, and living workers; workers end in between."""
    end_workers()  # workers of earlier tests
    folder, found = tmp_path_factory.mktemp("batches"), []
    for users in (None, "glibc.malloc.check=0"):
        with pytest.MonkeyPatch.context() as patch:
            patch.delenv(TUNABLES, raising=False)
            if users is not None:
                patch.setenv(TUNABLES, users)
            work = items(folder / str(users is None), ["a", "b"])
            run_batch("toy", work, write_process, replace(QUIET, workers=2))
            left = os.environ.get(TUNABLES)
        reports = [read_json(item.target) for item in work]
        end_workers()
        alive = [each for each in reports if psutil.pid_exists(each["process"])]
        found.append((reports, users, left, alive))
    return found


def test_ended_workers_are_gone_and_new_ones_do_the_next_batch(batches):
    for reports, _, _, alive in batches:
        assert os.getpid() not in {each["process"] for each in reports}
        assert not alive


def test_workers_use_huge_pages_unless_the_user_sets_tunables(batches):
    for reports, users, left, _ in batches:
        assert [each["tunables"] for each in reports] == [users or HUGE_PAGES] * 2
        assert left == users


def test_the_memory_of_loaded_networks_is_not_taken_for_a_leak(batches):
    for reports, *_ in batches:
        assert [each["leak"] for each in reports] == ["inf"] * 2


def end_itself_if_bad(item):
    if item.name == "bad":
        os.kill(os.getpid(), signal.SIGKILL)
    write_process(item)


@pytest.mark.skipif(sys.platform == "win32", reason="there is no such signal")
def test_an_item_whose_worker_is_killed_fails_alone(tmp_path, caplog):
    work = items(tmp_path, ["a", "b", "bad", *"cdefgh"])
    report = run_batch("toy", work, end_itself_if_bad, replace(QUIET, workers=2))
    assert report.done == list("abcdefgh")
    assert "bad" in report.failed
    assert "ended from outside, most likely for lack of memory" in report.failed["bad"]
    assert report.failed["bad"] in caplog.text
    assert os.getpid() not in {read_json(tmp_path / f"{name}.json")["process"] for name in "abcd"}
    end_workers()


def end_itself(number):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.skipif(sys.platform == "win32", reason="there is no such signal")
def test_a_worker_that_is_killed_while_it_loads_is_reported_in_one_sentence(tmp_path):
    with (
        pytest.raises(SymgraspError, match=r"a worker process was ended.*fewer --workers"),
        workers_of("loky", 2) as run,
    ):
        list(run(delayed(end_itself)(number) for number in range(2)))
    work = items(tmp_path / "after", ["a", "b"])  # new workers do the next batch
    assert run_batch("toy", work, write_process, replace(QUIET, workers=2)).done == ["a", "b"]
    end_workers()


def is_worker(process):
    try:
        return "LokyProcess" in " ".join(process.cmdline())
    except psutil.NoSuchProcess:  # a short process, such as a query for the processor
        return False


@pytest.mark.skipif(sys.platform == "win32", reason="there is no such signal")
def test_workers_end_with_a_command_that_is_ended_before_they_have_begun(frames, tmp_path):
    command = [sys.executable, "-c", "from symgrasp_cli.main import main; main()", "infer"]
    options = ["--out", tmp_path / "g.h5", "--workers", "2", "--method", "planar"]
    with subprocess.Popen([*command, frames, *options], stderr=subprocess.DEVNULL) as parent:
        workers: list[psutil.Process] = []
        while not any(is_worker(each) for each in workers):
            assert parent.poll() is None
            workers = psutil.Process(parent.pid).children(recursive=True)
            time.sleep(0.02)
        parent.send_signal(signal.SIGTERM)
        assert parent.wait(60) == 128 + signal.SIGTERM
    _, left = psutil.wait_procs(workers, timeout=30)
    assert not left


HALF_STARTED = """
import os, signal, sys, threading, time
from joblib import delayed
from joblib.externals.loky.backend import fork_exec
from pipelines.ending import end_on_signals
from pipelines.runtime.clusters import workers_of
end_on_signals()
threading.Thread(target=time.sleep, args=(600,), daemon=True).start()  # as that of a progress bar
start = fork_exec.fork_exec
def interrupted(*args, **names):
    worker = start(*args, **names)
    os.kill(os.getpid(), int(sys.argv[1]))
    return worker
fork_exec.fork_exec = interrupted
with workers_of("loky", 2) as run:
    list(run(delayed(time.sleep)(600) for _ in range(2)))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such signals")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_a_worker_starts_ends_the_run_without_a_traceback_of_the_worker(number):
    command = [sys.executable, "-c", HALF_STARTED, str(int(number))]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 128 + number
    assert "stopped by" in ended.stderr
    assert "Traceback" not in ended.stdout


PARENT = """
import os, sys, time
from joblib import delayed
from pipelines.runtime.clusters import workers_of
with workers_of("loky", 2) as run:
    print(*run(delayed(os.getpid)() for _ in range(4)), flush=True)
    time.sleep(600)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a process there keeps its parent's number")
def test_workers_and_their_trackers_end_with_a_parent_that_is_killed():
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE) as parent:
        workers = {int(each) for each in parent.stdout.readline().split()}
        children = psutil.Process(parent.pid).children(recursive=True)
        assert workers < {each.pid for each in children}
        parent.kill()
    _, left = psutil.wait_procs(children, timeout=60)
    assert not left


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    from tests.geometry.tabletops import Box, Can
    from tests.stages.test_infer import write_frame

    folder = tmp_path_factory.mktemp("frames")
    for number in range(5):
        write_frame(folder, f"f{number}", [Box((0.05 + 0.01 * number, 0.08, 0.1)), Can(0.03, 0.1)])
    write_frame(folder, "torn", [Box((0.05, 0.05, 0.05))])
    (folder / "torn_depth.png").write_bytes(b"\x89PNG")
    return folder


def find_grasps(frames, output, options):
    # Imported here, as workers import this module too, and toys need no slow imports.
    from pipelines import infer

    return infer.run(infer.InferPaths(frames, output), PLANAR, options)


@pytest.fixture(scope="module")
def alone(frames):
    """The output of this process for the frames, without a cluster."""
    output = frames.parent / "alone.h5"
    find_grasps(frames, output, QUIET)
    return output.read_bytes()


WITHOUT_SEMAPHORES = """
import _multiprocessing
import sys

class SemLock:
    SEM_VALUE_MAX = 1

    def __init__(self, *arguments, **names):
        raise OSError(38, "Function not implemented")

_multiprocessing.SemLock = SemLock
from symgrasp_cli.main import main

sys.argv = ["symgrasp", *sys.argv[1:]]
main()
"""


def test_a_command_starts_no_workers_where_the_system_has_no_semaphores(frames, alone):
    output = frames.parent / "without.h5"
    command = [sys.executable, "-c", WITHOUT_SEMAPHORES, "infer", str(frames), "--out", str(output)]
    options = ["--regions", "geometric", "--method", "planar", "--workers", "2"]
    run = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
    assert "Traceback" not in run.stderr, run.stderr
    assert run.returncode == 1
    assert "torn_depth.png" in run.stderr
    assert output.read_bytes() == alone


@pytest.fixture(scope="module")
def client():
    distributed = pytest.importorskip("distributed", reason="the extra `dask` is not installed")
    local = distributed.LocalCluster(n_workers=3, threads_per_worker=1, dashboard_address=None)
    with local, distributed.Client(local, set_as_default=False) as client:
        yield client


def test_an_existing_client_is_used(client, tmp_path):
    processes = client.run(os.getpid).values()
    with client.as_current():
        run_batch("toy", items(tmp_path, ["a"]), write_process, dask_of(1))
    assert read_json(tmp_path / "a.json")["process"] in processes


def test_dask_prints_nothing_about_its_connections(client, tmp_path):
    logging.getLogger("distributed").setLevel(logging.INFO)  # as its import does
    with client.as_current():
        run_batch("toy", items(tmp_path, ["a"]), write_process, dask_of(1))
    assert not logging.getLogger("distributed.core").isEnabledFor(logging.INFO)


def test_dask_writes_the_same_bytes_with_1_2_and_3_workers(client, frames, alone):
    for workers in (3, 2, 1):
        client.retire_workers(list(client.ncores())[workers:], close_workers=True)
        assert len(client.ncores()) == workers
        output = frames.parent / f"{workers}.h5"  # paths of frames are relative to the file
        with client.as_current():
            report = find_grasps(frames, output, dask_of(workers))
        assert len(report.done) == 5
        assert list(report.failed) == ["torn"]
        assert output.read_bytes() == alone


def own_a_ray_cluster(frames, output, folder):
    """Do two batches with one cluster, then wait to be killed."""
    import ray

    ray.init = partial(ray.init, num_gpus=1)
    options = ray_of(2)
    with workers_of("ray", 2):  # both batches find the cluster, as two batches of one program do
        assert_others_do_all_but_the_bad_item(options, folder)
        find_grasps(frames, output, options)
        assert not logging.getLogger("ray.util").isEnabledFor(logging.WARNING)  # prints nothing
        sys.stdout.write("done\n")
        sys.stdout.flush()
        time.sleep(600)


OWNER = """
import sys
from pathlib import Path
from tests.runtime.test_clusters import own_a_ray_cluster
own_a_ray_cluster(*map(Path, sys.argv[1:]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere ray ends its agents itself")
def test_workers_of_ray_write_the_same_bytes_and_end_with_a_killed_owner(frames, alone, tmp_path):
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    output = frames.parent / "ray.h5"
    command = [sys.executable, "-c", OWNER, frames, output, tmp_path]
    environment = {name: os.environ[name] for name in set(os.environ) - {"CUDA_VISIBLE_DEVICES"}}
    with subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True
    ) as owner:
        while (line := owner.stdout.readline()) != "done\n":
            assert line
        children = psutil.Process(owner.pid).children(recursive=True)
        assert len(children) > 3
        owner.kill()
    _, left = psutil.wait_procs(children, timeout=60)
    assert not left
    assert output.read_bytes() == alone
    assert {read_json(tmp_path / f"{name}.json")["gpus"] for name in "ab"} == {"all"}


@pytest.mark.parametrize("backend", ["dask", "ray"])
def test_a_cluster_that_is_not_installed_is_reported_in_one_sentence(
    tmp_path, monkeypatch, backend
):
    monkeypatch.setitem(sys.modules, MODULES[backend], None)
    options = replace(QUIET, backend=backend)
    with pytest.raises(SymgraspError, match=rf'pip install "symgrasp\[{backend}\]"'):
        run_batch("toy", items(tmp_path, ["a"]), write_process, options)


def test_a_scheduler_that_does_not_answer_is_reported_in_one_sentence(tmp_path):
    options, dask = dask_of(2), pytest.importorskip("dask")
    nobody = {"scheduler-address": "tcp://127.0.0.1:9", "distributed.comm.timeouts.connect": "1s"}
    with dask.config.set(nobody), pytest.raises(SymgraspError, match=r":9 does not answer"):
        run_batch("toy", items(tmp_path, ["a"]), write_process, options)


def test_an_unknown_backend_names_the_known_ones(tmp_path):
    options = replace(QUIET, workers=2, backend="slurm")
    with pytest.raises(UnknownNameError, match="loky, ray"):
        run_batch("toy", items(tmp_path, ["a"]), write_process, options)
