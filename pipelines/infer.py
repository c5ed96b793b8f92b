"""Stage `infer`: RGB-D frames in, ranked grasps out (Sec. III-D to III-F).

Reads   a folder of RGB-D frames in any layout that `frames/frames.py` knows; weights
Writes  one `grasps.h5` for all frames; with overlays, a picture per frame

Frames are processed in parallel: in threads, or, if there are many, in processes (D. 64). Each
finished frame is a part next to the output until all are done, so a killed run resumes where it
stopped and ends with the same bytes; the output is joined from the parts, so memory does not grow
with the number of frames. A frame that cannot be read is listed as failed and does not stop the
others; a frame with nothing to grasp is `empty`.
"""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

from pipelines.configs import InferConfig
from pipelines.dataset.chosen_frames import ALL_FRAMES, ChosenFrames
from pipelines.errors import StaleOutputError
from pipelines.frames.deeper_frames import warn_of_deeper_frames
from pipelines.frames.frame_options import NOTHING_STATED, FrameOptions
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_stream import read_index, read_results
from pipelines.inference.runs.earlier_runs import (
    earlier_frames,
    finished_items,
    has_part,
    holds_results,
    refuse_foreign_output,
    refuse_lost_parts,
    refuse_other_settings,
    refuse_stale,
)
from pipelines.inference.runs.frame_workers import load_in_workers, options_for_frames
from pipelines.inference.runs.infer_run import STAGE, InferRun, infer_frame, overlay_path
from pipelines.inference.runs.pictures import draw_missing, results_of_output
from pipelines.inference.runs.run_settings import InferPaths, RunSettings, check_config
from pipelines.runtime.batch import PASSING, BatchOptions, StageReport, WorkItem, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import make_folder, refuse_file_as_folder
from pipelines.storage.provenance import is_finished

__all__ = ["InferPaths", "infer_frame", "overlay_path", "run"]


@one_run_at_a_time(STAGE, "paths.output")
def run(
    paths: InferPaths,
    config: InferConfig,
    options: BatchOptions,
    *,
    stated: FrameOptions = NOTHING_STATED,
    seed: int = 0,
    device: str = "auto",
    timings: bool = False,
    choice: ChosenFrames = ALL_FRAMES,
) -> StageReport:
    """Find grasps in all frames of `paths.frames`.

    `stated`: camera and unit of all frames, in place of the ones in the files next to them.
    `timings`: write the seconds of each frame; the file then differs from run to run. `choice`:
    the frames of the folder to take.

    Raises:
        SymgraspError: no frames, unknown names, weights missing, or the output was made by another
            program or with other settings.
        WriteError: no space or no permission to write; finished frames stay.
    """
    check_config(config)
    refuse_foreign_output(paths.output)
    if paths.overlays is not None:
        refuse_file_as_folder(paths.overlays)
    settings = RunSettings(paths, config, seed, device, timings)
    settings.warn_of_unused_weights()
    run = InferRun(settings, stated, choice)
    sources = run.find()
    warn_of_deeper_frames(paths.frames, sources)
    items = run.items(sources)
    if not options.overwrite:
        refuse_lost_parts(run, items)
    if not options.overwrite and holds_results(paths.output) and _is_complete(run, items):
        if not options.dry_run:
            grasps_file.remove_parts(paths.output)  # the parts of `infer --watch`
        report = _finished_report(paths, len(items))
    else:
        report = _make(run, items, options)
    undrawn = draw_missing(settings, results_of_output(paths.output, items), options)
    report.failed |= undrawn
    report.done, report.skipped = (
        [name for name in names if name not in undrawn] for names in (report.done, report.skipped)
    )
    return report


def _make(run: InferRun, items: Sequence[WorkItem], options: BatchOptions) -> StageReport:
    """Find the grasps of the unfinished frames, and assemble the output."""
    settings = run.settings
    if options.dry_run:
        done = [item for item in items if has_part(item)]
    else:
        done = finished_items(run, items, overwrite=options.overwrite)
    finished = {item.name: item for item in done}
    todo = [item for item in items if item.name not in finished]
    # Parts have this run's stamp, so --overwrite keeps them; a dry run leaves stale ones.
    options = replace(options, overwrite=options.dry_run)
    parallel = options_for_frames(options, len(todo), settings.device)
    with settings.one_core() if parallel.backend == "threading" else nullcontext():
        if todo and not options.dry_run:
            make_folder(grasps_file.parts_folder(run.output))  # before the work, if it cannot be
            load_in_workers(settings, parallel)
        report = run_batch(STAGE, todo, partial(infer_frame, settings=settings), parallel)
    report.skipped += finished
    if not options.dry_run:
        run.assemble(items, report.failed)
        if PASSING.isdisjoint(report.failed.values()):  # else the next run continues from the parts
            grasps_file.remove_parts(run.output)
    return report


def _is_complete(run: InferRun, items: Sequence[WorkItem]) -> bool:
    """Return whether the output is complete: that of `items`.

    A run of `infer --watch`, which leaves its parts, may have ended before more frames arrived; and
    frames that lacked memory are tried again.

    Raises:
        StaleOutputError: the settings or inputs differ; no image is read to compare settings.
        SymgraspError: the output is one of `infer --watch`, with frames that exist nowhere else.
    """
    refuse_other_settings(run)
    if not PASSING.isdisjoint(read_index(run.output).messages):
        return False
    try:
        return is_finished(run.output, run.output_stamp(items))
    except StaleOutputError:
        if not earlier_frames(run):
            raise
        refuse_stale(run, {item.name for item in items})
        return False


def _finished_report(paths: InferPaths, count: int) -> StageReport:
    """Return the report of a finished output with `count` frames."""
    report = StageReport(STAGE)
    for result in read_results(paths.output, range(count)):
        if result.status == "failed":
            report.failed[result.name] = result.message
        else:
            report.skipped.append(result.name)
    return report
