"""Tally of an export: numbers of grasps written and left out, with reasons, as notes."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipelines.errors import counted
from pipelines.grasp_files.exports.export_poses import ExportGripper
from pipelines.grasp_files.exports.grasp_exports import FrameGrasps

NAMED_AT_MOST = 10  # frames named in a sentence


@dataclass
class ExportTally:
    """Numbers of grasps; `left_out`: frame to places of grasps too wide for the gripper."""

    written: int = 0
    low: int = 0
    left_out: dict[str, NDArray[np.int64]] = field(default_factory=dict)

    def counted(self, frames: Iterable[FrameGrasps]) -> Iterator[FrameGrasps]:
        """Yield the frames, and count their written and left-out grasps."""
        for frame in frames:
            self.written += len(frame)
            self.low += len(frame.low)
            if len(frame.left_out):
                self.left_out[frame.result.name] = frame.left_out
            yield frame

    def notes(
        self, output: str, num_frames: int, gripper: ExportGripper, min_score: float
    ) -> dict[str, str]:
        """Return sentences on the export called `output`, with `num_frames` written frames."""
        name, behind = gripper.model.name, 1000 * gripper.base_to_contacts
        written = f"{counted(self.written, 'grasp')} in {counted(num_frames, 'frame')}"
        made = (
            f"{written}; gripper {name}, origin of the "
            f"poses {abs(behind):.1f} mm {'behind' if behind >= 0 else 'beyond'} the contacts"
        )
        if not gripper.is_the_one_checked:
            made += f"; collisions were checked with {gripper.checked_with}, not with {name}"
        if self.low:
            made += f"; left out {counted(self.low, 'grasp')} with a score below {min_score:g}"
        if not self.left_out:
            return {output: made}
        named = list(self.left_out.items())[:NAMED_AT_MOST]
        places = [f"{frame} {as_ranges(rows)}" for frame, rows in named]
        if len(self.left_out) > NAMED_AT_MOST:
            places.append(f"and more in {counted(len(self.left_out) - NAMED_AT_MOST, 'frame')}")
        count = sum(map(len, self.left_out.values()))
        wide = (
            f"{count} of {counted(self.written + self.low + count, 'grasp')} wider than the "
            f"{1000 * gripper.model.max_width:.0f} mm that {name} takes; their places in "
            f"/grasps: {'; '.join(places)}"
        )
        return {output: made, "left out": wide}


def as_ranges(places: NDArray[np.int64]) -> str:
    """Return ascending whole numbers as text, with consecutive numbers as first-last: 3, 5-9."""
    runs = np.split(places, np.flatnonzero(np.diff(places) != 1) + 1)
    return ", ".join(str(r[0]) if len(r) == 1 else f"{r[0]}-{r[-1]}" for r in runs if len(r))
