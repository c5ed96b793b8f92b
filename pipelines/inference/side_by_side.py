"""Frames spread over threads and processes, each with its networks loaded."""

from dataclasses import replace

from joblib import cpu_count, delayed

from pipelines.inference import models
from pipelines.inference.run_settings import Settings
from pipelines.runtime.batch import CHOSEN, BatchOptions
from pipelines.runtime.clusters import CLUSTERS, workers_of

MAX_THREADS = 4
FRAMES_A_PROCESS = 8


def side_by_side(options: BatchOptions, frames: int, device: str) -> BatchOptions:
    """Return how `frames` are worked on where the user does not say it.

    Threads of this process wait for Python's lock a third of the time; with many frames on a
    CPU, processes of their own are worth what starting them takes: one for every eight frames, up
    to `options.most_chosen`.
    """
    options = options.for_items(frames)
    if options.backend in CLUSTERS or options.workers > 1:
        return options
    processes = min(cpu_count(), options.most_chosen, frames // FRAMES_A_PROCESS)
    if options.workers == CHOSEN and processes > 1 and not models.uses_gpu(device):
        return replace(options, workers=processes)
    return replace(options, workers=min(cpu_count(), MAX_THREADS), backend="threading")


def load(settings: Settings, options: BatchOptions) -> None:
    """Load all networks where they will run, so that a failure is reported once.

    Raises:
        SymgraspError: something does not load.
    """
    if options.backend == "threading":
        settings.planner()
    elif options.backend not in CLUSTERS:  # theirs start anew for each batch
        with workers_of(options.backend, options.workers) as run:
            list(run(delayed(_load)(settings) for _ in range(options.workers)))


def _load(settings: Settings) -> None:
    settings.planner()
