"""Pictures of frames with grasps from an earlier run.

A frame's picture is normally drawn when its grasps are found. If an earlier run found the grasps,
the picture is drawn from that run's results, unless an existing picture has their stamp.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from pipelines.grasp_files.grasps_stream import read_index, read_results
from pipelines.inference.runs.infer_run import STAGE, overlay_path, reporting_write_errors
from pipelines.inference.runs.run_settings import RunSettings
from pipelines.pictures.overlays import is_drawn, write_overlay
from pipelines.runtime.batch import BatchOptions, WorkItem, run_batch

# A frame, the `grasps.h5` of its results, and their index there.
FoundResult = tuple[WorkItem, Path, int]


def results_of_output(output: Path, items: Sequence[WorkItem]) -> Iterator[FoundResult]:
    """Yield the frames of `output`, which was made from `items`, without failed frames."""
    for place, status in enumerate(read_index(output).statuses):
        if status != "failed":
            yield items[place], output, place


def draw_missing(
    settings: RunSettings, frames: Iterable[FoundResult], options: BatchOptions
) -> dict[str, str]:
    """Draw the pictures of `frames` that are missing or show other results, if any are wanted.

    Returns:
        The reason why a frame has no picture, by frame name.

    Raises:
        WriteError: no space or no permission to write.
    """
    folder = settings.paths.overlays
    if folder is None or options.dry_run:
        return {}
    todo = [
        WorkItem(item.name, path, item.stamp, (*item.arguments, results, place))
        for item, results, place in frames
        if not is_drawn(path := overlay_path(folder, item.name), item.stamp)
    ]
    # No threads: after an error in one thread, another thread within OpenCV would block the exit.
    workers = 1 if options.backend == "threading" else max(1, options.workers)
    drawing = replace(options, overwrite=True, workers=workers)
    failed = run_batch(f"{STAGE}: pictures", todo, _draw, drawing).failed
    return {name: f"has grasps but no picture: {why}" for name, why in failed.items()}


def _draw(item: WorkItem) -> None:
    source, _, results, place = item.arguments
    (result,) = read_results(results, [place])
    frame = source.read()
    with reporting_write_errors(item.target):
        write_overlay(item.target, frame, result, item.stamp)
