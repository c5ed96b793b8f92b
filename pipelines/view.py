"""Stage `view`: interactive 3D pages of frames with their symmetries and grasps.

Reads   grasps.h5                 of `infer`
        the RGB-D frames          where `infer` read them, or another folder
Writes  OUT/frames/NAME.html      one page per frame, which needs no other file and no network
        OUT/frames/NAME.jpg       the frame's picture
        OUT/frames/NAME.rrd       if requested: the same for rerun's viewer
        OUT/index.html            all frames, with pictures and links

A page with its stamp is finished, so a killed run resumes where it stopped, and only the pages of
new or changed frames are made. Frames that `infer` failed on, or that cannot be read any more, are
reported and listed without a page; a page of other grasps or images stays, and is marked.
"""

import os
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2

from pipelines.configs import ViewConfig
from pipelines.errors import FormatError, StaleOutputError, SymgraspError, counted
from pipelines.frames.frame_inputs import is_made_of
from pipelines.frames.frames_record import FramesRecord
from pipelines.frames.rgbd import Frame, FrameSource
from pipelines.grasp_files.grasp_checks import refuse_wrong_grasps
from pipelines.grasp_files.grasps_stream import read_index, read_results, read_sound
from pipelines.grasp_files.grasps_tables import FrameResult, result_digest
from pipelines.grasp_files.gripper_files import gripper_digest, gripper_to_use, load_gripper
from pipelines.pictures.grasp_page.page import IndexEntry, frame_page, index_page, result_words
from pipelines.pictures.grasp_page.scene import frame_scene
from pipelines.pictures.overlays import draw_overlay
from pipelines.pictures.rerun_recording import need_rerun, write_recording
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.files import (
    LONGEST_NAME,
    real_path,
    refuse_file_as_folder,
    within,
    write_text,
)
from pipelines.storage.images import write_image
from pipelines.storage.provenance import Stamp, digest, is_finished, make_stamp, read_stamp

STAGE = "view"
STALE = "a page of other grasps or images; view with --overwrite makes it again"


@dataclass(frozen=True)
class ViewPaths:
    """Paths that `view` reads and writes; `frames` None: the folder that `infer` read."""

    grasps: Path
    output: Path
    frames: Path | None = None

    @property
    def index(self) -> Path:
        """The page of all frames."""
        return self.output / "index.html"

    def of_frame(self, name: str, suffix: str) -> Path:
        """Return the path of a frame's file.

        Raises:
            SymgraspError: the name, or a link, leads out of the folder.
        """
        folder = self.output / "frames"
        path = folder / f"{name}{suffix}"
        longest = max(len(os.fsencode(part)) for part in path.parts)
        if (
            not name
            or longest > LONGEST_NAME
            or not real_path(path).is_relative_to(real_path(folder))
        ):
            raise FormatError(
                self.grasps, f"the frame's name {name!r} is no file name", "run infer"
            )
        return within(self.output, path)


@one_run_at_a_time(STAGE, "paths.output")
def run(
    paths: ViewPaths, config: ViewConfig, options: BatchOptions, *, rerun: bool = False
) -> StageReport:
    """Make the pages of all frames of `paths.grasps`; `rerun`: also recordings for its viewer.

    Raises:
        SymgraspError: no such file or frames, rerun is not installed, or the output was made by
            another program or with other settings.
    """
    if rerun:
        need_rerun()
    index = read_index(paths.grasps)
    gripper = gripper_to_use(config.gripper, index.gripper, index.stamp)
    config = replace(config, gripper=gripper)
    whole = make_stamp(STAGE, config, inputs={"gripper": gripper_digest(gripper)})
    _check_output(paths, whole, overwrite=options.overwrite)
    sources = FramesRecord.of(paths.grasps, index.attrs, paths.frames).sources()
    items, failed = _items(paths, index.names, whole, sources)
    report = _make_pages(paths, config, items, options)
    report.failed = failed | report.failed
    if is_made_of(index.stamp, index.names, sources) is False:
        report.notes["frames"] = (
            "their files are others than those that infer read, so that the grasps may not fit them"
        )
    if rerun:
        _record(paths, config, items, options, report)
    # An index without pages would replace that of the pages of an earlier run.
    if not options.dry_run and not report.failed.keys() >= {*index.names}:
        title = f"{paths.grasps.name}: {counted(len(index.names), 'frame')}"
        stale = {each.name for each in items if _is_stale(each, report)}
        entries = _entries(paths, index.names, report, stale)
        write_text(paths.index, index_page(title, entries, whole))
    return report


def _make_pages(
    paths: ViewPaths, config: ViewConfig, items: Sequence[WorkItem], options: BatchOptions
) -> StageReport:
    """Make the unfinished pages, and those whose pictures are lost."""
    step = partial(make_page, paths=paths, config=config)
    lost = {item.name for item in items if not paths.of_frame(item.name, ".jpg").is_file()}
    report = run_batch(STAGE, [item for item in items if item.name not in lost], step, options)
    again = replace(options, overwrite=True)
    report.add(run_batch(STAGE, [item for item in items if item.name in lost], step, again))
    return report


def make_page(item: WorkItem, paths: ViewPaths, config: ViewConfig) -> str | None:
    """Write the picture and the page of one frame; return the page's size and its result."""
    frame, result = _frame_of(item, paths)
    height, width = frame.depth.shape
    size = (config.picture_width, max(1, round(height * config.picture_width / width)))
    picture = cv2.resize(draw_overlay(frame, result), size, interpolation=cv2.INTER_AREA)
    write_image(paths.of_frame(item.name, ".jpg"), picture)
    scene = frame_scene(frame, result, load_gripper(config.gripper), config)
    page = frame_page(scene, result, item.stamp)
    write_text(item.target, page)
    return f"{len(page) / 1e6:.1f} MB, {result_words(result)}"


def make_recording(item: WorkItem, paths: ViewPaths, config: ViewConfig) -> str | None:
    """Write the recording of one frame for rerun's viewer."""
    frame, result = _frame_of(item, paths)
    write_recording(item.target, frame, result, load_gripper(config.gripper), item.stamp)
    return None


def _frame_of(item: WorkItem, paths: ViewPaths) -> tuple[Frame, FrameResult]:
    """Return a frame with the camera that its grasps were found with, and the grasps."""
    source, place = item.arguments
    result = next(read_results(paths.grasps, [place]))
    refuse_wrong_grasps(result.grasps)
    frame = source.read()
    height, width = frame.depth.shape
    if (width, height) != result.size:
        found = f"is {width}x{height}, but its grasps are of {result.size[0]}x{result.size[1]}"
        raise FormatError(item.name, found, "give --frames, the folder infer was run on")
    return replace(frame, intrinsics=result.intrinsics), result


def _check_output(paths: ViewPaths, whole: Stamp, *, overwrite: bool) -> None:
    """Refuse a folder that was made by another program or with other settings."""
    refuse_file_as_folder(paths.output)
    if paths.index.exists():
        stamp = read_stamp(paths.index)
        if stamp is None or stamp.get("stage") != STAGE:
            raise SymgraspError(
                f"{paths.index} exists and is no output of view; choose another --out"
            )
        is_finished(paths.index, whole, overwrite=overwrite)


def _items(
    paths: ViewPaths, names: Sequence[str], whole: Stamp, sources: Mapping[str, FrameSource]
) -> tuple[list[WorkItem], dict[str, str]]:
    """Return the pages to make, and the reasons why other frames have none."""
    items, failed = [], dict[str, str]()
    digests: dict[Path, str] = {}  # a bag is one file of many frames: it is read once
    for place, _first, result in read_sound(paths.grasps, names, failed):
        source = sources.get(result.name)
        try:
            target = paths.of_frame(result.name, ".html")
        except SymgraspError as error:
            failed[result.name] = str(error)
            continue
        if result.status == "failed" or result.intrinsics is None:
            failed[result.name] = f"infer failed on it ({result.message}); it has no page"
        elif source is None:
            failed[result.name] = (
                "its images do not exist any more; give --frames, their folder"
                if paths.frames is None
                else f"{paths.frames} has no frame {result.name}; give the folder that infer read"
            )
        else:
            inputs = dict(whole.inputs) | {"grasps": result_digest(result)}
            for number, path in enumerate(source.files):
                digests[path] = digests.get(path) or digest(path)
                inputs[f"{number} {path.name}"] = digests[path]
            items.append(
                WorkItem(result.name, target, replace(whole, inputs=inputs), (source, place))
            )
    return items, failed


def _record(
    paths: ViewPaths,
    config: ViewConfig,
    items: list[WorkItem],
    options: BatchOptions,
    report: StageReport,
) -> None:
    """Write recordings of the frames that have pages; add failures to `report`."""
    wanted = [
        replace(item, target=paths.of_frame(item.name, ".rrd"))
        for item in items
        if item.name not in report.failed
    ]
    step = partial(make_recording, paths=paths, config=config)
    recorded = run_batch(f"{STAGE} for rerun", wanted, step, options)
    report.failed |= recorded.failed
    report.notes |= {f"{name}.rrd": note for name, note in recorded.notes.items()}
    made = {*report.done, *recorded.done}
    both = [item.name for item in wanted if item.name not in recorded.failed]
    report.done = [name for name in both if name in made]
    report.skipped = [name for name in both if name not in made]
    report.seconds += recorded.seconds


def _is_stale(item: WorkItem, report: StageReport) -> bool:
    return report.failed.get(item.name) == str(StaleOutputError(item.target))


def _entries(
    paths: ViewPaths, names: Sequence[str], report: StageReport, stale: Container[str]
) -> Iterator[IndexEntry]:
    places = [place for place, name in enumerate(names) if name not in report.failed]
    results = read_results(paths.grasps, places)
    for name in names:
        failure = report.failed.get(name)
        if failure is not None and name not in stale:
            yield IndexEntry(name, None, None, failure, failed=True)
            continue
        page, picture = (
            paths.of_frame(name, suffix).relative_to(paths.output).as_posix()
            for suffix in (".html", ".jpg")
        )
        words = STALE if failure is not None else result_words(next(results))
        yield IndexEntry(name, page, picture, words, failed=failure is not None)
