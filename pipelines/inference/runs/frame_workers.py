"""Distribution of frames over threads and processes, each with loaded networks."""

from dataclasses import replace

from joblib import cpu_count, delayed

from pipelines.inference import models
from pipelines.inference.runs.run_settings import RunSettings
from pipelines.runtime.batch import CHOSEN, BatchOptions
from pipelines.runtime.clusters import CLUSTERS, workers_of

MAX_THREADS = 4  # of one process, which wait for Python's lock; chosen by eye
FRAMES_A_PROCESS = 8  # at least, for a process that has to load all networks; chosen by eye


def options_for_frames(options: BatchOptions, frames: int, device: str) -> BatchOptions:
    """Return `options` with the number of workers for `frames`, if the user gives none.

    Threads of one process wait for Python's lock a third of the time. With many frames on a CPU,
    starting processes pays off: one for every `FRAMES_A_PROCESS`, up to `options.most_chosen`.

    Args:
        options: options of the batch, with the user's number of workers or `CHOSEN`.
        frames: number of frames to process; 0 if they are yet to come.
        device: device of the networks.
    """
    options = options.for_items(frames)
    if options.backend in CLUSTERS or options.workers > 1:
        return options
    processes = min(cpu_count(), options.most_chosen, frames // FRAMES_A_PROCESS)
    if options.workers == CHOSEN and processes > 1 and not models.uses_gpu(device):
        return replace(options, workers=processes)
    return replace(options, workers=min(cpu_count(), MAX_THREADS), backend="threading")


def load_in_workers(settings: RunSettings, options: BatchOptions) -> None:
    """Load all networks in every worker, so that a failure is reported once.

    Raises:
        SymgraspError: a network does not load.
    """
    if options.backend == "threading":
        settings.planner()
    elif options.backend not in CLUSTERS:  # workers of clusters start anew for each batch
        with workers_of(options.backend, options.workers) as run:
            list(run(delayed(_load)(settings) for _ in range(options.workers)))


def _load(settings: RunSettings) -> None:
    settings.planner()
