"""Pictures of frames whose grasps are there already.

A frame's picture is drawn as its grasps are found. Where an earlier run found them, it is drawn
from its results, unless the picture that is there is stamped as theirs.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from pipelines.grasp_files.grasps_stream import read_index, read_results
from pipelines.inference.run_settings import Settings
from pipelines.inference.work import STAGE, overlay_path, writing
from pipelines.pictures.overlays import is_drawn, write_overlay
from pipelines.runtime.batch import BatchOptions, WorkItem, run_batch

Found = tuple[WorkItem, Path, int]  # a frame; the `grasps.h5` of its results, and their place there


def of_output(output: Path, items: Sequence[WorkItem]) -> Iterator[Found]:
    """Yield the frames of `output`, which was made of `items`, but those that failed."""
    for place, status in enumerate(read_index(output).statuses):
        if status != "failed":
            yield items[place], output, place


def draw_missing(
    settings: Settings, frames: Iterable[Found], options: BatchOptions
) -> dict[str, str]:
    """Draw the pictures of `frames` that are not there, or of other results, where any are wanted.

    Returns:
        Why a frame has no picture, by its name.

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
    # Not in threads: one in OpenCV, when another's fault ends the program, would not let it end.
    workers = 1 if options.backend == "threading" else max(1, options.workers)
    beside = replace(options, overwrite=True, workers=workers)
    failed = run_batch(f"{STAGE}: pictures", todo, _draw, beside).failed
    return {name: f"its grasps are found, not its picture: {why}" for name, why in failed.items()}


def _draw(item: WorkItem) -> None:
    source, results, place = item.arguments
    (result,) = read_results(results, [place])
    frame = source.read()
    with writing(item.target):
        write_overlay(item.target, frame, result, item.stamp)
