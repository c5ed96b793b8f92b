"""Stage `inspect`: summary of the RGB-D frames that `infer` would read from a folder.

Reads   a folder of RGB-D frames in any layout of `frames/layouts`, or one of its files
Writes  nothing

Frames of one layout, size, camera and unit are listed together. Frames that cannot be read count as
failed, with the sentence that `infer` would print.
"""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.configs import InspectConfig
from pipelines.errors import counted
from pipelines.frames.deeper_frames import warn_of_deeper_frames
from pipelines.frames.depth.registration import oddities
from pipelines.frames.frame_options import NOTHING_STATED, FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.rgbd import Frame, FrameSource
from pipelines.geometry.camera import Intrinsics
from pipelines.runtime.batch import StageReport

STAGE = "inspect"
RANGE = (1, 99)  # percentiles of the measured depth: a few pixels are always outliers


@dataclass(frozen=True)
class FrameFacts:
    """Facts about one frame."""

    layout: str
    name: str
    intrinsics: Intrinsics
    units_per_metre: float | None
    depth_range: tuple[float, float]  # m
    measured: float  # share of the pixels
    odd: tuple[str, ...]


@dataclass(frozen=True)
class Findings:
    """Summary of a folder: numbers of frames by layout, and facts about the frames read.

    `groups`: frames of the same layout, size, camera and unit.
    """

    found: Counter[str]
    groups: list[list[FrameFacts]]
    report: StageReport


def run(frames: Path, config: InspectConfig, *, stated: FrameOptions = NOTHING_STATED) -> Findings:
    """Read the frames of a folder or file, evenly spread if there are many; summarise them.

    `stated`: camera and unit of all frames, in place of the ones in the files next to them.

    Raises:
        SymgraspError: no frames.
    """
    started, report = time.monotonic(), StageReport(STAGE)
    sources = find_frames(frames, stated)
    warn_of_deeper_frames(frames, sources)
    groups: dict[object, list[FrameFacts]] = {}
    for source in _spread(sources, config.max_frames):
        with report.attempting(source.name):
            look = _look(source, source.read())
            groups.setdefault((look.layout, look.intrinsics, look.units_per_metre), []).append(look)
    report.seconds = time.monotonic() - started
    return Findings(Counter(source.layout for source in sources), list(groups.values()), report)


def findings_lines(findings: Findings) -> list[str]:
    """Return the findings as lines of text."""
    read = len(findings.report.done) + len(findings.report.failed)
    lines = [f"{counted(count, 'frame')} as {layout}" for layout, count in findings.found.items()]
    if read < findings.found.total():
        lines.append(f"{read} of them were read, evenly spread")
    for group in findings.groups:
        lines += ["", *_group_lines(group)]
    return lines


def _spread(sources: Sequence[FrameSource], most: int) -> list[FrameSource]:
    if len(sources) <= most:
        return list(sources)
    return [sources[round(i)] for i in np.linspace(0, len(sources) - 1, most)]


def _look(source: FrameSource, frame: Frame) -> FrameFacts:
    measured = frame.depth[frame.depth > 0]
    near, far = (float(value) for value in np.percentile(measured, RANGE))
    share = measured.size / frame.depth.size
    return FrameFacts(
        source.layout,
        source.name,
        frame.intrinsics,
        frame.units_per_metre,
        (near, far),
        share,
        oddities(frame),
    )


def _group_lines(group: Sequence[FrameFacts]) -> list[str]:
    first, camera = group[0], group[0].intrinsics
    names = first.name if len(group) == 1 else f"{first.name} ... {group[-1].name}"
    near = min(look.depth_range[0] for look in group)
    far = max(look.depth_range[1] for look in group)
    measured = float(np.mean([look.measured for look in group]))
    units = first.units_per_metre
    unit = "metres" if units in (None, 1.0) else f"{units:g} units per metre"
    odd = Counter(sentence for look in group for sentence in look.odd)
    facts = {
        "layout": first.layout,
        "frames": f"{len(group)}: {names}",
        "size": f"{camera.width}x{camera.height}",
        "intrinsics": f"fx {camera.fx:g}, fy {camera.fy:g}, cx {camera.cx:g}, cy {camera.cy:g}",
        "depth": f"{near:.3f} to {far:.3f} m, {measured:.0%} measured; stored as {unit}",
        "odd": "; ".join(f"{text} ({times}x)" for text, times in odd.items()) or "nothing",
    }
    return [f"{key:<12}{text}" for key, text in facts.items()]
