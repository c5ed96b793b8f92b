"""Stage `convert-frames`: RGB-D frames of any layout as flat pairs, the simplest layout.

Reads   frames in any layout of `frames/layouts`; pickles only if they are trusted
Writes  OUT/NAME_color.png, OUT/NAME_depth.png, OUT/NAME_camera.json, OUT/provenance.json

Nothing is lost: depth that does not fit into 16 bits, as floats, goes to `NAME_depth.npz`. The
folder appears once it is complete; frames that cannot be read count as failed and are left out.
The stamp records them, so that a second run reports them again.
"""

import itertools
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from pipelines.configs import ConvertFramesConfig
from pipelines.contents import mapping_in
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.frames.deeper_frames import warn_of_deeper_frames
from pipelines.frames.depth.depth_checks import MISSING_DEPTH
from pipelines.frames.frame_inputs import current_digest
from pipelines.frames.frame_options import NOTHING_STATED, FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import Frame, FrameSource
from pipelines.runtime.batch import StageReport
from pipelines.runtime.one_run import one_run_at_a_time
from pipelines.storage.array_files import write_npz
from pipelines.storage.files import atomic_folder, real_path, write_json
from pipelines.storage.images import write_image
from pipelines.storage.provenance import (
    digest_text,
    is_finished,
    make_stamp,
    read_stamp,
    refuse_foreign,
    write_sidecar,
)

STAGE = "convert-frames"
LEAF = "frames"  # folder of the frames that are next to folders with frames


@one_run_at_a_time(STAGE, "output")
def run(
    frames: Path,
    output: Path,
    config: ConvertFramesConfig,
    *,
    stated: FrameOptions = NOTHING_STATED,
    overwrite: bool = False,
) -> StageReport:
    """Write the frames of `frames`, a folder or one file of a frame, into the folder `output`.

    `stated`: camera and unit of all frames, in place of the ones in the files next to them.

    Raises:
        SymgraspError: no frames, or `output` was made by another program or with other settings.
    """
    started, report = time.monotonic(), StageReport(STAGE)
    sources = find_frames(frames, replace(stated, trust_pickles=config.trust_pickle))
    warn_of_deeper_frames(frames, sources)
    names = separate_names([source.name for source in sources])
    overrides = f"{stated.camera} {stated.depth_units_per_metre}"
    stamp = make_stamp(STAGE, config, inputs={"frames": _digest(sources), "overrides": overrides})
    refuse_foreign(output, STAGE)
    if real_path(frames).is_relative_to(real_path(output)):
        raise ValueRangeError("--out", output, f"a folder that does not hold the frames, {frames}")
    if is_finished(output, stamp, overwrite=overwrite):
        _report_again(report, sources, names, output)
        return report
    with atomic_folder(output) as folder:
        for source, name in zip(sources, names, strict=True):
            with report.attempting(name):
                write_flat_pair(folder, replace(source.read(), name=name))
        if not report.done:
            raise SymgraspError(report.why_all_failed("can be read, nothing is written"))
        _fail_hidden(report, folder)
        write_sidecar(folder, replace(stamp, recorded={"failed": report.failed}))
    report.seconds = time.monotonic() - started
    return report


def separate_names(names: Sequence[str]) -> list[str]:
    """Return `names` with no frame next to a folder of other frames, where neither hides the other.

    A folder that holds frames is not searched further down, so its frames go to a folder there.
    """
    paths = [PurePosixPath(name) for name in names]
    folders = {path.parent for path in paths}
    above = {upper for folder in folders for upper in folder.parents}

    def place_below(folder: PurePosixPath) -> PurePosixPath:
        numbered = (f"{LEAF}-{number}" for number in itertools.count(2))
        places = (folder / leaf for leaf in itertools.chain([LEAF], numbered))
        return next(place for place in places if place not in folders and place not in above)

    places = {folder: place_below(folder) for folder in folders & above}
    return [str(places.get(path.parent, path.parent) / path.name) for path in paths]


def _fail_hidden(report: StageReport, folder: Path) -> None:
    """Count frames as failed that are not found again in `folder`, such as in hidden folders."""
    found = {source.name for source in find_frames(folder, may_be_empty=True)}
    hidden = [name for name in report.done if name not in found]
    why = "is not found again under this name among the others; give its images another name"
    report.failed |= dict.fromkeys(hidden, why)
    report.done = [name for name in report.done if name in found]


def _report_again(
    report: StageReport, sources: Sequence[FrameSource], names: Sequence[str], output: Path
) -> None:
    """Count `names` as skipped, or as failed with the sentence that the earlier run recorded.

    Frames whose files are lost are written again.
    """
    recorded = mapping_in(mapping_in(read_stamp(output), "recorded"), "failed")
    for source, name in zip(sources, names, strict=True):
        if name in recorded:
            report.failed[name] = f"{recorded[name]} (--overwrite tries it again)"
        elif _is_written(output, name):
            report.skipped.append(name)
        else:
            with report.attempting(name):
                write_flat_pair(output, replace(source.read(), name=name))


def _is_written(folder: Path, name: str) -> bool:
    depths = (folder / f"{name}_depth{suffix}" for suffix in (".png", ".npz"))
    others = (folder / f"{name}_color.png", folder / f"{name}_camera.json")
    return all(path.is_file() for path in others) and any(path.is_file() for path in depths)


def write_flat_pair(folder: Path, frame: Frame) -> None:
    """Write one frame as a flat pair, which reads back equal to the last bit."""
    units = frame.units_per_metre or 1.0
    stored = np.round(frame.depth.astype(np.float64) * units)
    camera = frame.intrinsics
    facts = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    write_image(folder / f"{frame.name}_color.png", frame.color)
    again = stored.astype(np.float32) / np.float32(units)
    # A `depth_scale` of 1 would be read as BOP's.
    if units > 1.0 and stored.max() < MISSING_DEPTH and (again == frame.depth).all():
        write_image(folder / f"{frame.name}_depth.png", stored.astype(np.uint16))
        facts["depth_scale"] = units
    else:
        write_npz(folder / f"{frame.name}_depth.npz", depth=frame.depth)
    write_json(folder / f"{frame.name}_camera.json", facts)


def _digest(sources: Sequence[FrameSource]) -> str:
    lines = [f"{each.name} {' '.join(map(current_digest, each.files))}" for each in sources]
    return digest_text("\n".join(lines))
