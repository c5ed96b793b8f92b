"""Workers of a batch: processes of this machine, or a dask or ray cluster.

A running cluster is used: that of `DASK_SCHEDULER_ADDRESS` or `RAY_ADDRESS`, or of a client in the
calling program. Otherwise workers are started on this machine and ended with the batch. Workers
read and write the same paths, so a cluster needs a shared file system.
"""

import logging
import math
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from multiprocessing.dummy import DummyProcess
from types import ModuleType
from typing import Any, TypeVar

from joblib import Parallel, parallel_config
from joblib.externals.loky import get_reusable_executor, process_executor, reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from pipelines.ending import (
    begin_worker,
    remove_joblib_folders,
    signal_handlers_kept,
    signals_put_off,
)
from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.runtime.ray_watch import ended_with_owner
from pipelines.storage.temporary import is_running

RunTasks = Callable[[Iterable[Any]], Iterator[Any]]  # tasks of joblib's `delayed` to their results
T = TypeVar("T")
R = TypeVar("R")
BACKENDS = ("loky", "threading", "dask", "ray")
CLUSTERS = ("dask", "ray")
# Ray hides the GPUs from tasks that reserve none, as joblib's tasks do; --device chooses the GPU.
SEE_ALL_GPUS = {"RAY_EXPERIMENTAL_NOSET_CUDA_VISIBLE_DEVICES": "1"}
WORKER_ENDED = "a worker process was ended from outside, most likely for lack of memory"
LONGEST_ITEM = 60.0  # seconds to wait for an item of an interrupted batch
TUNABLES, HUGE_PAGES = "GLIBC_TUNABLES", "glibc.malloc.hugetlb=1"


class WorkerEndedError(SymgraspError):
    """The operating system, or another program, has ended a worker process."""

    def __init__(self) -> None:
        super().__init__(
            f"{WORKER_ENDED}; give fewer --workers, the same command continues from here"
        )
        self.arguments = ()


def check_backend(backend: str) -> None:
    """Raise UnknownNameError if there is no such backend."""
    if backend not in BACKENDS:
        raise UnknownNameError("backend", backend, BACKENDS)


@contextmanager
def workers_of(backend: str, workers: int) -> Iterator[RunTasks]:
    """Yield a function that runs tasks on `workers` processes (threads if `threading`), in order.

    Processes end with this process, whatever ends it; Ctrl-C is left to this process.

    Raises:
        UnknownNameError: no such backend.
        SymgraspError: the backend is not installed, or its scheduler does not answer.
        WorkerEndedError: a worker of this machine was killed.
    """
    check_backend(backend)
    others = set(threading.enumerate())
    if backend == "dask":
        with _dask(workers), parallel_config(backend="dask"):
            yield _parallel_run()
    elif backend == "ray":
        with _ray(workers), parallel_config(backend="ray", n_jobs=workers):
            yield Parallel()  # its pool returns no result before all are done
    else:
        try:
            remove_joblib_folders(lambda process: not is_running(process))
            begin = _beginning() if backend == "loky" else {}
            with _huge_pages(), parallel_config(backend, n_jobs=workers, **begin):
                yield _parallel_run()
        except TerminatedWorkerError as error:
            raise WorkerEndedError from error
        finally:
            _await_threads(set(threading.enumerate()) - others)


def one_by_one(step: Callable[[T], R], items: Iterable[T]) -> Iterator[R | None]:
    """Yield the result of `step` on each of `items`, one at a time in a process of this machine.

    None for an item whose process was killed, which ends no other item.
    """
    try:
        for item in items:
            with _huge_pages(), signals_put_off():
                result = get_reusable_executor(1, **_beginning()).submit(step, item)
            try:
                yield result.result()
            except TerminatedWorkerError:
                yield None
    finally:
        end_workers()  # joblib cannot use an executor that it has not made


def _beginning() -> dict[str, Any]:
    return {"initializer": _begin_worker, "initargs": (os.getpid(),)}


def _begin_worker(parent: int) -> None:
    begin_worker(parent)
    # loky mistakes loaded networks for a memory leak, and would end the worker with a warning.
    process_executor._MAX_MEMORY_LEAK_SIZE = math.inf


def _parallel_run() -> RunTasks:
    """Return a function that calls joblib's `Parallel`, which starts workers at the first tasks."""
    parallel = Parallel(return_as="generator")

    def run(tasks: Iterable[Any]) -> Iterator[Any]:
        with signals_put_off():
            results: Iterator[Any] = parallel(tasks)
        return results

    return run


def _await_threads(started: set[threading.Thread]) -> None:
    """Wait until the threads of an interrupted batch have ended their items.

    joblib leaves the threads working; a process that ends meanwhile is aborted by their C++ code.
    """
    for thread in started:
        if isinstance(thread, DummyProcess):
            thread.join(LONGEST_ITEM)


@contextmanager
def _huge_pages() -> Iterator[None]:
    """Let processes that start in the context keep large arrays in huge pages, on Linux.

    Pages of 4 kB, freed and allocated again, cost `infer` a twelfth of its time. The C library
    reads this from the environment alone; a value that the user has set stays.
    """
    if TUNABLES in os.environ:
        yield
        return
    os.environ[TUNABLES] = HUGE_PAGES
    try:
        yield
    finally:
        os.environ.pop(TUNABLES, None)


def end_workers() -> None:
    """End the idle processes of loky, in which torch would otherwise take seconds to end."""
    if reusable_executor._executor is not None:  # `get_reusable_executor` would make an executor
        get_reusable_executor(reuse=True).shutdown(kill_workers=True)


@contextmanager
def _dask(workers: int) -> Iterator[None]:
    """Connect to a dask scheduler, or to workers started here, until the context ends."""
    distributed = _optional_module("distributed", "dask")
    logging.getLogger("distributed").setLevel(logging.ERROR)  # else a line for each connection
    try:
        distributed.get_client()
    except ValueError:  # this program has no client yet
        pass
    else:
        yield
        return
    if address := import_module("dask").config.get("scheduler-address", None):
        try:
            client = distributed.Client(address)
        except (OSError, ValueError) as error:
            raise SymgraspError(
                f"the dask scheduler {address} does not answer ({error}); "
                "start it, or unset DASK_SCHEDULER_ADDRESS"
            ) from error
        with client:
            yield
        return
    local = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        memory_limit=None,  # else a worker ends that takes more than its share of the memory
        dashboard_address=None,
        silence_logs=logging.ERROR,
    )
    with local, distributed.Client(local):
        yield


@contextmanager
def _ray(workers: int) -> Iterator[None]:
    """Connect to a ray cluster, or to a cluster started here, until the context ends."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no statistics are sent
    ray = _optional_module("ray", "ray")
    import_module("ray.util.joblib").register_ray()
    if ray.is_initialized():
        yield
        return
    try:
        settings: dict[str, Any] = {
            "log_to_driver": False,
            "logging_level": logging.ERROR,
            "runtime_env": {"env_vars": SEE_ALL_GPUS},
        }
        if "RAY_ADDRESS" not in os.environ:
            settings |= {"num_cpus": workers, "include_dashboard": False}
        with signal_handlers_kept():  # ray's handlers abort the process
            ray.init(**settings)
    except (ConnectionError, OSError) as error:
        raise SymgraspError(
            f"the ray cluster does not answer ({error}); start it, or unset RAY_ADDRESS"
        ) from error
    with ended_with_owner(_ray_processes()):
        try:
            yield
        finally:
            ray.shutdown()


def _ray_processes() -> list[int]:
    """Return the processes of the cluster that this process started; none of other clusters."""
    node = import_module("ray._private.worker")._global_node
    if node is None or "RAY_ADDRESS" in os.environ:
        return []
    return [info.process.pid for infos in node.all_processes.values() for info in infos]


def _optional_module(module: str, extra: str) -> ModuleType:
    """Return an optional module.

    Raises:
        SymgraspError: the module is not installed; the message has the command to install it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise SymgraspError(
            f"--backend {extra} needs {module}, which is not installed; "
            f'run: pip install "symgrasp[{extra}]"'
        ) from error
