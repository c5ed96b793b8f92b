"""`success.trials/*.json`: what became of the trials of a scene, enough to compute any rate again.

Records are written scene by scene, so that an interrupted run loses nothing.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pipelines.contents import reading, typed
from pipelines.evaluation.rows import OURS
from pipelines.storage.files import read_json, write_json
from pipelines.storage.provenance import Stamp

FORMAT_VERSION = 1
HELD = "held"  # the reason of a trial that succeeded


@dataclass(frozen=True)
class Outcome:
    """What became of a trial.

    Attributes:
        reason: one of `simulation.trial.REASONS`.
        slip: metres that the object moved in the gripper from closing to the end.
        turn: degrees that it turned in the gripper.
    """

    reason: str
    slip: float = 0.0
    turn: float = 0.0


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
    """All trials of one frame.

    Attributes:
        name: of the frame.
        split: of its scene.
        shift: metres that an object moved at most to come to rest.
        trials: of our grasps.
        baselines: of those of other methods.
    """

    name: str
    split: str
    shift: float
    trials: list[TrialRecord]
    baselines: dict[str, list[TrialRecord]] = field(default_factory=dict)

    @property
    def rows(self) -> dict[str, list[TrialRecord]]:
        """The trials by method, ours first."""
        return {OURS: self.trials, **self.baselines}


def friction_key(friction: float) -> str:
    """Return the name of a friction in JSON: 0.3 is "0.3"."""
    return f"{friction:g}"


def trials_folder(success: Path) -> Path:
    """Return where the trials of `success`, a `success.json`, lie, one file a scene."""
    return success.with_suffix(".trials")


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
    with reading(path, "the record of a scene's trials", "delete it and run `simulate` again"):
        return [typed(FrameTrials, entry) for entry in content["frames"]]
