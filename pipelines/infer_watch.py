"""Stage `infer --watch`: grasps of each frame as a camera writes it, until the stage is stopped.

Reads   a folder that RGB-D frames are written into; weights
Writes  `grasps.h5.parts/FRAME.h5` as soon as a frame's grasps are found, and `grasps.h5` of all
        frames so far: whenever no frame arrives, for a tenth of the time at most, and at the end,
        if that takes no more than a few seconds after a signal

Both appear by renaming, so that a reader always sees whole files. The parts stay: the same command
resumes from them, and `infer` without `--watch` ends with the same bytes and removes them.
"""

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace

from pipelines.configs import InferConfig, WatchConfig
from pipelines.dataset.chosen_frames import ALL_FRAMES, ChosenFrames
from pipelines.errors import SymgraspError
from pipelines.frames.frame_options import NOTHING_STATED, FrameOptions
from pipelines.inference.runs.earlier_runs import refuse_foreign_output
from pipelines.inference.runs.following import Follower, FrameOutcome
from pipelines.inference.runs.frame_workers import options_for_frames
from pipelines.inference.runs.infer_run import STAGE, InferRun
from pipelines.inference.runs.run_settings import InferPaths, RunSettings, check_config
from pipelines.inference.runs.watching import Clock
from pipelines.runtime.batch import BatchOptions, StageReport
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.runtime.stopping import StopReason, StopSignals


@one_run_at_a_time(STAGE, "paths.output")
def run(
    paths: InferPaths,
    config: InferConfig,
    options: BatchOptions,
    *,
    watch: WatchConfig,
    notify: Callable[[FrameOutcome], None],
    stated: FrameOptions = NOTHING_STATED,
    seed: int = 0,
    device: str = "auto",
    timings: bool = False,
    choice: ChosenFrames = ALL_FRAMES,
    clock: Clock | None = None,
    writer: Executor | None = None,
) -> StageReport:
    """Find grasps in new frames of `paths.frames` until SIGINT, SIGTERM or time-out.

    The work is done in threads of this process. `notify`: called with each processed frame.
    `stated`: camera and unit of all frames, in place of the ones in the files next to them.
    `clock`: the machine's by default; `writer`: executor that writes the output, a thread by
    default. Tests pass their own.

    Raises:
        SymgraspError: no such folder, unknown names, weights missing, or the output was made by
            another program or with other settings, or has frames that exist nowhere else.
        WriteError: no space or no permission to write; the same command resumes.
    """
    check_config(config)
    refuse_foreign_output(paths.output)
    _refuse_impossible(paths, options)
    run = InferRun(RunSettings(paths, config, seed, device, timings), stated, choice)
    run.settings.warn_of_unused_weights()
    signals = StopSignals()
    # Each frame gets a line instead of progress.
    options = replace(options_for_frames(options, 0, device), progress=False)
    threads, thread = ThreadPoolExecutor(options.workers), ThreadPoolExecutor(1)
    with threads, thread, signals.recorded(expects_repeats=False), run.settings.one_core():
        follower = Follower(
            run, watch, options, notify, clock or Clock(), threads, writer or thread
        )
        follower.begin(overwrite=options.overwrite)
        while signals.reason is StopReason.NONE and not follower.is_timed_out():
            follower.poll()
        return follower.end(is_stopped=signals.reason is not StopReason.NONE)


def _refuse_impossible(paths: InferPaths, options: BatchOptions) -> None:
    if not paths.frames.is_dir():
        raise SymgraspError(f"{paths.frames} is no folder; give the folder that receives frames")
    if paths.masks is not None:
        raise SymgraspError(
            "--watch and --masks exclude each other: masks of later frames do not exist yet"
        )
    if not options.is_here or options.dry_run:
        raise SymgraspError(
            "--watch runs in one process, on all its cores; leave out --workers, --backend and "
            "--dry-run, and SYMGRASP_WORKERS and SYMGRASP_BACKEND"
        )
