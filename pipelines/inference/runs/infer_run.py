"""One run of `infer`: its frames one by one, their parts, and the output.

Each finished frame is a part next to the output, until the output is merged from all parts.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pipelines.dataset.chosen_frames import ALL_FRAMES, ChosenFrames
from pipelines.errors import WriteError
from pipelines.frames.depth.registration import oddities
from pipelines.frames.frame_inputs import FRAMES_INPUT, FrameInputs, digest_of_stamps
from pipelines.frames.frame_names import shared_last_parts
from pipelines.frames.frame_options import NOTHING_STATED, FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.frames_record import FramesRecord
from pipelines.frames.rgbd import FrameSource
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_parts import merge_parts
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.inference.runs.run_settings import RunSettings
from pipelines.inference.user_masks import drawn_by_user
from pipelines.pictures.overlays import write_overlay
from pipelines.runtime.batch import WorkItem
from pipelines.storage.files import within
from pipelines.storage.provenance import Stamp, digest_text, make_stamp, read_stamp

STAGE = "infer"


@dataclass(frozen=True)
class InferRun:
    """One run of `infer`: settings, and options for reading the frames.

    Attributes:
        settings: of every frame.
        stated: camera and unit of all frames, instead of those in the files next to the frames.
        choice: chosen frames of the folder.
    """

    settings: RunSettings
    stated: FrameOptions = NOTHING_STATED
    choice: ChosenFrames = ALL_FRAMES

    @property
    def output(self) -> Path:
        """The `grasps.h5` to write."""
        return self.settings.paths.output

    @cached_property
    def weight_digests(self) -> Mapping[str, str]:
        """Digests of the weights, by model."""
        return self.settings.weight_digests()

    @cached_property
    def shared_inputs(self) -> Mapping[str, str]:
        """Digests of all inputs that the frames share."""
        camera, units = self.stated.camera, self.stated.depth_units_per_metre
        stated = f"{camera} {units} {self.settings.timings}"
        others = self.settings.other_digests()
        return {**self.weight_digests, **others, "overrides": digest_text(stated)}

    def find(self, *, may_be_empty: bool = False) -> list[FrameSource]:
        """List the chosen frames of the folder; see `find_frames`."""
        found = find_frames(
            self.settings.paths.frames,
            self.stated,
            camera=self.choice.camera,
            scenes=self.choice.scenes,
            may_be_empty=may_be_empty,
        )
        return self.choice.of(found)

    def items(self, sources: Sequence[FrameSource]) -> list[WorkItem]:
        """Return one work item, with a part as target, for each of `sources`."""
        shared, items = self.stamp(self.shared_inputs), []
        last_parts = shared_last_parts(source.name for source in sources)
        for source in sources:
            stamp = replace(shared, inputs=FrameInputs(self.shared_inputs, source.files))
            target = grasps_file.part_path(self.output, source.name)
            items.append(WorkItem(source.name, target, stamp, (source, last_parts)))
        return items

    def stamp(self, inputs: Mapping[str, str]) -> Stamp:
        """Return the stamp of a result made from `inputs`."""
        config, seed = self.settings.config, self.settings.seed
        return make_stamp(STAGE, config, seed=seed, inputs=inputs)

    def output_stamp(self, items: Sequence[WorkItem]) -> Stamp:
        """Return the stamp of the output with `items`; reads all files of the items."""
        frames = digest_of_stamps((item.name, item.stamp) for item in items)
        record = FramesRecord(self.settings.paths.frames, self.stated).beside(self.output)
        return replace(self.stamp({**self.shared_inputs, FRAMES_INPUT: frames}), recorded=record)

    def assemble(
        self,
        items: Sequence[WorkItem],
        failed: Mapping[str, str],
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Write the output from the parts of `items`.

        `failed`: sentence on the fault of each failed frame, by name. `check`: called between
        frames; if it raises, nothing is written.
        """
        parts = [
            FrameResult(item.name, "failed", failed[item.name], seconds=np.nan)
            if item.name in failed
            else item.target
            for item in items
        ]
        for item in items:
            check()
            if item.name not in failed and not inputs_of(item).are_known:
                inputs_of(item).take_over(read_stamp(item.target) or {}, unchecked=True)
        merge_parts(self.output, parts, self.output_stamp(items), self.weight_digests, check)


def infer_frame(item: WorkItem, settings: RunSettings) -> str | None:
    """Write the part of one frame; return a note if the frame is odd or empty."""
    with settings.one_core():
        source, shared_parts = item.arguments
        # Before the frame is read, so that the result is stale if a file changes meanwhile.
        signatures = inputs_of(item).signatures()
        frame = source.read()
        rng = np.random.default_rng(settings.seed)
        drawn = drawn_by_user(settings.paths, source.name, frame, shared_parts)
        result = settings.planner().plan(frame, rng, *drawn)
        seconds = result.seconds if settings.timings else np.nan
        result = replace(result, name=source.name, seconds=seconds)
        if settings.paths.overlays is not None:
            picture = overlay_path(settings.paths.overlays, source.name)
            with reporting_write_errors(picture):
                write_overlay(picture, frame, result, item.stamp)
        with reporting_write_errors(item.target):
            stamp = replace(item.stamp, recorded={"files": signatures})
            grasps_file.write(item.target, [result], stamp)
        return "; ".join(filter(None, (*oddities(frame), result.message))) or None


@contextmanager
def reporting_write_errors(path: Path) -> Iterator[None]:
    """Raise WriteError, which is no fault of a frame, if `path` cannot be written."""
    try:
        yield
    except OSError as error:
        raise WriteError(path, error.strerror or str(error)) from error


def overlay_path(folder: Path, frame_name: str) -> Path:
    """Return the path of a frame's picture; errors as in `within`."""
    return within(folder, folder / f"{frame_name}.png")


def inputs_of(item: WorkItem) -> FrameInputs:
    """Return the inputs of `item`, one of `InferRun.items`."""
    inputs = item.stamp.inputs
    # The digests of a frame of an earlier run are known.
    return inputs if isinstance(inputs, FrameInputs) else FrameInputs(inputs, ())
