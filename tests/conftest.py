"""Settings and fixtures of all tests: the folder of real data, and how workers share a machine."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings

MEMORY_OF_WORKER = 2e9  # bytes; the largest tests train a detector

# One thread in each process and its children: threads that wait for each other cost toy networks
# ten times the work, and workers share the cores.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# Otherwise each worker, and each command that a test starts, compiles all modules anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# No test may fail because a machine is busy or by chance: the examples are the same everywhere.
settings.register_profile("untimed", deadline=None, derandomize=True)
settings.load_profile("untimed")

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder `shared` of real frames and meshes; skips the test where there is none."""
    if not SHARED.is_dir():
        pytest.skip(f"{SHARED} is not there: real frames and meshes are not part of the project")
    return SHARED


@pytest.fixture(scope="session", autouse=True)
def files_are_not_synced() -> Iterator[None]:
    """Leave files in the system's cache: no test cuts the power, and a disk takes milliseconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _descriptor: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def loops_are_compiled_by_one_worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let a worker wait while another compiles the loop it needs, and load the cached loop then."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        yield
        return
    from numba.core.dispatcher import Dispatcher

    folder, compile_or_load = tmp_path_factory.getbasetemp().parent, Dispatcher.compile

    def one_at_a_time(loop: Dispatcher, signature: object) -> object:
        module, name = loop.py_func.__module__ or "", loop.py_func.__qualname__
        if not module.startswith("pipelines."):
            return compile_or_load(loop, signature)
        with FileLock(folder / f"{module}.{name}.lock"):
            return compile_or_load(loop, signature)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dispatcher, "compile", one_at_a_time)
        yield


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option `--golden`, which writes the golden files anew; review the difference."""
    parser.addoption("--golden", action="store_true", help="write the golden files anew")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Return the number of workers of `-n auto`: as many as there are cores and memory for."""
    from joblib import cpu_count

    from pipelines.health.machine import free_memory

    memory = free_memory()
    fitting = cpu_count() if memory is None else int(memory // MEMORY_OF_WORKER)
    return max(1, min(cpu_count(), fitting))
