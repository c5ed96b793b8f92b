"""What became of the trials of a frame, as JSON: enough to compute every rate again.

Records are written scene by scene, so that an interrupted run loses nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipelines.errors import FormatError
from pipelines.formats.files import read_json, write_json
from pipelines.formats.provenance import Stamp
from pipelines.simulation.trial import Outcome

FORMAT_VERSION = 1


@dataclass(frozen=True)
class TrialRecord:
    """The best grasp on one visible object of a frame.

    Attributes:
        object_id: of the dataset.
        kind: symmetry of the true region that it is on: sphere, rotation, reflection or none.
        outcomes: by friction, see `friction_key`.
    """

    object_id: int
    kind: str
    outcomes: dict[str, Outcome]


@dataclass(frozen=True)
class FrameTrials:
    """All trials of one frame; `shift`: metres that an object moved at most to come to rest."""

    name: str
    split: str
    shift: float
    trials: list[TrialRecord]


def friction_key(friction: float) -> str:
    """Return the name of a friction in JSON: 0.3 is "0.3"."""
    return f"{friction:g}"


def write_trials(path: Path, frames: Sequence[FrameTrials], stamp: Stamp) -> None:
    """Write the trials of one scene."""
    content = {
        "format_version": FORMAT_VERSION,
        "frames": [asdict(frame) for frame in frames],
        "provenance": stamp.as_json(),
    }
    write_json(path, content)


def read_trials(path: Path) -> list[FrameTrials]:
    """Read the trials of one scene.

    Raises:
        FormatError: not written by `write_trials`.
    """
    content = read_json(path)
    try:
        return [_frame(entry) for entry in content["frames"]]
    except (KeyError, TypeError) as error:
        raise FormatError(
            path, f"not the trials of a scene ({error})", "delete it and run `simulate` again"
        ) from error


def _frame(entry: Mapping[str, Any]) -> FrameTrials:
    trials = [
        TrialRecord(
            trial["object_id"],
            trial["kind"],
            {key: Outcome(**outcome) for key, outcome in trial["outcomes"].items()},
        )
        for trial in entry["trials"]
    ]
    return FrameTrials(entry["name"], entry["split"], entry["shift"], trials)
