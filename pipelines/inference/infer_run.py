"""One run of `infer`: its frames one by one, their parts, and the output.

Each finished frame is a part next to the output, until the output is merged from all parts. A
run may continue from the results of an earlier run with the same settings, or overwrite them.
"""

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from pipelines.dataset.chosen_frames import ALL_FRAMES, ChosenFrames
from pipelines.errors import (
    FormatError,
    StaleOutputError,
    SymgraspError,
    WriteError,
)
from pipelines.frames.frame_inputs import FrameInputs
from pipelines.frames.frame_names import shared_last_parts
from pipelines.frames.frames import find_frames
from pipelines.frames.frames_record import FramesRecord
from pipelines.frames.registration import oddities
from pipelines.frames.rgbd import FrameSource
from pipelines.frames.rgbd_folder import NOTHING_STATED, FrameOptions
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_parts import merge_parts
from pipelines.grasp_files.grasps_stream import read_index
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.inference.run_settings import RunSettings
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
        unknown = [inputs for item in items if not (inputs := inputs_of(item)).are_known]
        with ThreadPoolExecutor() as threads:  # digests release Python's lock
            list(threads.map(dict, unknown))
        frames = digest_text("\n".join(f"{item.name} {item.stamp.as_digest()}" for item in items))
        record = FramesRecord(self.settings.paths.frames, self.stated).beside(self.output)
        return replace(self.stamp({**self.shared_inputs, "frames": frames}), recorded=record)

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


def finished_items(items: Sequence[WorkItem]) -> list[WorkItem]:
    """Return the items with valid parts.

    Damaged parts, and those of a killed run with other settings, are removed: they are of no use.
    """
    finished = []
    for item in items:
        if has_part(item):
            finished.append(item)
        else:
            item.target.unlink(missing_ok=True)
    return finished


def has_part(item: WorkItem) -> bool:
    """Return whether the part of `item` exists and has the item's stamp."""
    if not item.target.exists():
        return False
    found = _stamp_of_part(item.target)
    inputs_of(item).take_over(found)
    return {**found, "recorded": None} == {**item.stamp.as_json(), "recorded": None}


def _stamp_of_part(path: Path) -> dict[str, Any]:
    """Return the stamp of a part; empty if it has none, or is damaged."""
    try:
        return read_stamp(path) or {}
    except FormatError:
        return {}


def inputs_of(item: WorkItem) -> FrameInputs:
    """Return the inputs of `item`, one of `InferRun.items`."""
    inputs = item.stamp.inputs
    # The digests of a frame of an earlier run are known.
    return inputs if isinstance(inputs, FrameInputs) else FrameInputs(inputs, ())


def refuse_foreign_output(output: Path) -> None:
    """Raise SymgraspError if `output` exists and was not written by `infer`."""
    if not output.exists():
        return
    ours = output.is_file() and h5py.is_hdf5(output)
    with suppress(FormatError):  # without a readable stamp there is nothing to lose
        ours = ours and (read_stamp(output) or {}).get("stage") == STAGE
    if not ours:
        raise SymgraspError(f"{output} exists and is no grasps.h5; choose another output")


def earlier_frames(run: InferRun, known: Container[Path] = ()) -> dict[str, WorkItem]:
    """Return the finished frames of an earlier run with the same settings, by name.

    Parts that are `known` are left out.
    """
    wanted, items = run.stamp(run.shared_inputs).as_json(), {}
    parts = sorted(grasps_file.parts_folder(run.output).glob("[!.]*.h5"))
    for path in (each for each in parts if each not in known):
        found = _stamp_of_part(path)
        if (
            _has_same_settings(found, wanted)
            and wanted["inputs"].items() <= found["inputs"].items()
        ):
            (name,) = read_index(path).names
            stamp = Stamp(STAGE, found["config"], found["seed"], found["inputs"])
            items[name] = WorkItem(name, path, stamp)
    return items


def refuse_lost_parts(run: InferRun, items: Sequence[WorkItem]) -> None:
    """Raise SymgraspError if there are parts of frames that `items` lack.

    A run of `infer --watch` was killed, and the camera has removed the images since.
    """
    if lost := list(earlier_frames(run, {item.target for item in items})):
        raise SymgraspError(
            f"{grasps_file.parts_folder(run.output)} holds {len(lost)} finished frames that are "
            f"not among those of {run.settings.paths.frames} now, for example {lost[0]}; --watch "
            "writes them too, --overwrite drops them"
        )


def holds_results(output: Path) -> bool:
    """Return whether `output` exists with a frame that has not failed."""
    return output.exists() and any(each != "failed" for each in read_index(output).statuses)


def refuse_stale(run: InferRun, known: set[str]) -> None:
    """Raise unless an existing output has these settings and only frames that are `known`."""
    if not holds_results(run.output):
        return
    refuse_other_settings(run)
    index = read_index(run.output)
    states = zip(index.names, index.statuses, strict=True)
    lost = [name for name, status in states if status != "failed" and name not in known]
    if lost:
        raise SymgraspError(
            f"{run.output} holds {len(lost)} frames that are no longer in "
            f"{run.settings.paths.frames}, for example {lost[0]}; choose another output, or pass "
            "--overwrite"
        )


def refuse_other_settings(run: InferRun) -> None:
    """Raise StaleOutputError unless the output has these settings; read no images."""
    found, wanted = read_stamp(run.output) or {}, run.stamp(run.shared_inputs).as_json()
    inputs = {name: each for name, each in found.get("inputs", {}).items() if name != "frames"}
    if not _has_same_settings(found, wanted) or inputs != wanted["inputs"]:
        raise StaleOutputError(run.output)


def _has_same_settings(found: dict[str, object], wanted: dict[str, object]) -> bool:
    return all(found.get(key) == wanted[key] for key in ("stage", "config", "seed"))
