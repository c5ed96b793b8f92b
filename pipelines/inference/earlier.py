"""The results of an earlier run: whether this run may go on from them, or write over them."""

from contextlib import suppress
from pathlib import Path

import h5py

from pipelines.errors import FormatError, StaleOutputError, SymgraspError
from pipelines.grasp_files import grasps_file
from pipelines.grasp_files.grasps_stream import read_index
from pipelines.inference.work import STAGE, Work
from pipelines.runtime.batch import WorkItem
from pipelines.storage.provenance import Stamp, read_stamp


def refuse_others_work(output: Path) -> None:
    """Raise SymgraspError if `output` exists and `infer` did not write it: it may be anybody's."""
    if not output.exists():
        return
    ours = output.is_file() and h5py.is_hdf5(output)
    with suppress(FormatError):  # so damaged that it does not say: there is nothing to lose
        ours = ours and (read_stamp(output) or {}).get("stage") == STAGE
    if not ours:
        raise SymgraspError(f"{output} exists and is no grasps.h5; choose another output")


def earlier_frames(work: Work) -> dict[str, WorkItem]:
    """Return the finished frames of an earlier run that followed a folder likewise, by name."""
    wanted, items = work.stamp(work.common).as_json(), {}
    parts = sorted(grasps_file.parts_folder(work.output).glob("[!.]*.h5"))
    for path in parts:
        found = read_stamp(path) or {}
        if _is_alike(found, wanted) and wanted["inputs"].items() <= found["inputs"].items():
            (name,) = read_index(path).names
            stamp = Stamp(STAGE, found["config"], found["seed"], found["inputs"])
            items[name] = WorkItem(name, path, stamp)
    return items


def refuse_stale(work: Work, known: set[str]) -> None:
    """Raise unless an existing output is of these settings and of frames that are `known`."""
    if not work.output.exists():
        return
    refuse_other_settings(work)
    index = read_index(work.output)
    states = zip(index.names, index.statuses, strict=True)
    lost = [name for name, status in states if status != "failed" and name not in known]
    if lost:
        raise SymgraspError(
            f"{work.output} holds {len(lost)} frames that are not in {work.settings.paths.frames} "
            f"any more, {lost[0]} among them; choose another output, or pass --overwrite"
        )


def refuse_other_settings(work: Work) -> None:
    """Raise StaleOutputError unless the output is of these settings; no image is read for it."""
    found, wanted = read_stamp(work.output) or {}, work.stamp(work.common).as_json()
    inputs = {name: each for name, each in found.get("inputs", {}).items() if name != "frames"}
    if not _is_alike(found, wanted) or inputs != wanted["inputs"]:
        raise StaleOutputError(work.output)


def _is_alike(found: dict[str, object], wanted: dict[str, object]) -> bool:
    return all(found.get(key) == wanted[key] for key in ("stage", "config", "seed"))
