"""`success.trials/*.json`: outcomes of the trials of a scene, enough to compute any rate again.

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
    """The outcome of a trial, and the object's motion in the gripper from closing to the end."""

    reason: str  # one of `simulation.trial.TRIAL_OUTCOMES`
    slip: float = 0.0  # metres
    turn: float = 0.0  # degrees


@dataclass(frozen=True)
class TrialRecord:
    """The trials of the best grasp on one visible object of a frame."""

    object_id: int
    kind: str  # symmetry of the true region under the grasp: sphere, rotation, reflection or none
    outcomes: dict[str, Outcome]  # by `number_key`


@dataclass(frozen=True)
class FrameTrials:
    """All trials of one frame: `trials` of our grasps, `baselines` of other methods."""

    name: str
    split: str
    shift: float  # metres that an object moved at most to come to rest
    trials: list[TrialRecord]
    baselines: dict[str, list[TrialRecord]] = field(default_factory=dict)

    @property
    def rows(self) -> dict[str, list[TrialRecord]]:
        """The trials by method, ours first."""
        return {OURS: self.trials, **self.baselines}


def trials_folder(success: Path) -> Path:
    """Return the folder of the trials of `success`, a `success.json`, one file per scene."""
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
        FormatError: the file was not written by `write_trials`.
    """
    content = read_json(path)
    with reading(path, "the record of a scene's trials", "delete it and run `simulate` again"):
        return [typed(FrameTrials, entry) for entry in content["frames"]]
