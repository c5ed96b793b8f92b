"""Results of earlier runs of `infer`: parts to continue from, and outputs that may not be lost.

A run continues from the parts of an earlier run with the same settings, or overwrites them.
"""

import logging
from collections.abc import Container, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import h5py

from pipelines.errors import FormatError, StaleOutputError, SymgraspError, counted
from pipelines.frames.frame_inputs import FRAMES_INPUT
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_stream import read_index
from pipelines.inference.runs.infer_run import STAGE, InferRun, inputs_of
from pipelines.runtime.batch import WorkItem, warn_of_removed
from pipelines.storage.files import remove_file
from pipelines.storage.provenance import Stamp, read_stamp

log = logging.getLogger(__name__)


def finished_items(run: InferRun, items: Sequence[WorkItem], *, overwrite: bool) -> list[WorkItem]:
    """Return the items with valid parts; remove all other parts.

    A warning counts the removed parts, damaged or of a run with other settings; with `overwrite`
    only those of frames that `items` lack.
    """
    finished = [item for item in items if has_part(item)]
    others = sorted(_parts(run) - {item.target for item in finished})
    if overwrite:
        warn_of_lost_parts(run, items)
    else:
        warn_of_removed(others)
    for part in others:
        remove_file(part)
    return finished


def _parts(run: InferRun) -> set[Path]:
    return set(grasps_file.parts_folder(run.output).glob("[!.]*.h5"))


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
    for path in (each for each in sorted(_parts(run)) if each not in known):
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
            f"{grasps_file.parts_folder(run.output)} holds {counted(len(lost), 'finished frame')} "
            f"not among those of {run.settings.paths.frames} now, for example {lost[0]}; --watch "
            "writes them too, --overwrite drops them"
        )


def warn_of_lost_parts(run: InferRun, items: Sequence[WorkItem]) -> None:
    """Warn that --overwrite removes parts of frames that `items` lack, which are not made again."""
    if lost := sorted(_parts(run) - {item.target for item in items}):
        log.warning(
            "--overwrite removes the grasps of %s not among those of %s now, for example %s",
            counted(len(lost), "frame"),
            run.settings.paths.frames,
            unquote(lost[0].stem),
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
            f"{run.output} holds {counted(len(lost), 'frame')} not among those of "
            f"{run.settings.paths.frames} now, for example {lost[0]}; choose another output, or "
            "pass --overwrite"
        )


def refuse_other_settings(run: InferRun) -> None:
    """Raise StaleOutputError unless the output has these settings; read no images."""
    found, wanted = read_stamp(run.output) or {}, run.stamp(run.shared_inputs).as_json()
    inputs = {name: each for name, each in found.get("inputs", {}).items() if name != FRAMES_INPUT}
    if not _has_same_settings(found, wanted) or inputs != wanted["inputs"]:
        raise StaleOutputError(run.output)


def _has_same_settings(found: dict[str, object], wanted: dict[str, object]) -> bool:
    return all(found.get(key) == wanted[key] for key in ("stage", "config", "seed"))
