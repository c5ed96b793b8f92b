"""Summary of a finished `grasps.h5`: numbers of grasps and frames, reasons of empty frames."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipelines.errors import counted
from pipelines.grasp_files.grasps_stream import read_index

NAMED = 5  # largest number of frames that a sentence names


@dataclass(frozen=True)
class GraspsSummary:
    """Counts of a file, and its frames without a grasp."""

    frames: int  # including failed frames
    grasps: int
    empty: dict[str, str]  # name of a frame without a grasp -> reason
    failed: int

    def lines(self) -> Iterator[str]:
        """Yield sentences for people."""
        full = self.frames - len(self.empty) - self.failed
        yield f"{counted(self.grasps, 'grasp')} on {full} of {counted(self.frames, 'frame')}"
        by_reason: dict[str, list[str]] = {}
        for name, reason in self.empty.items():
            by_reason.setdefault(reason, []).append(name)
        for reason, names in by_reason.items():
            more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
            yield f"no grasp: {', '.join(names[:NAMED])}{more}: {reason}"


def summary_of(path: Path) -> GraspsSummary:
    """Return the summary of the `grasps.h5` at `path`.

    Raises:
        FormatError: the file is no complete grasps.h5.
    """
    index = read_index(path)
    frames = list(zip(index.names, index.statuses, index.messages, strict=True))
    empty = {name: message for name, status, message in frames if status == "empty"}
    return GraspsSummary(len(frames), index.num_grasps, empty, index.statuses.count("failed"))
