"""Records of evaluated frames as JSON: enough to compute every figure again.

Records are written scene by scene, so that an interrupted run loses nothing and figures of any
subset of frames can be formed later (splits, confidence intervals).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pipelines.contents import reading, typed
from pipelines.evaluation.rows import BASELINE_ROWS, OURS
from pipelines.metrics.grasp_verdicts import Verdict
from pipelines.storage.files import finite_json, read_json, write_json
from pipelines.storage.provenance import Stamp

FORMAT_VERSION = 1


@dataclass(frozen=True)
class ScoredPredictions:
    """Predictions of one kind in one frame.

    `verdicts`: by threshold, one per prediction: 1 right, 0 wrong, -1 ignored.
    """

    num_truth: int  # number of true ones to find
    confidence: list[float] = field(default_factory=list)
    verdicts: dict[str, list[int]] = field(default_factory=dict)


@dataclass(frozen=True)
class RowRecord:
    """The results of one method on one frame.

    `symmetries`: by kind; empty for a method that predicts none. `accuracy`: by GraspNet's
    protocol, the mean over ranks at each of `AP_FRICTIONS`; empty in older records. `masks`: the
    regions of a `--with` file; None for other rows, methods without regions, and older records.
    """

    verdicts: list[Verdict]  # one for every visible object
    symmetries: dict[str, ScoredPredictions] = field(default_factory=dict)
    accuracy: list[float] = field(default_factory=list)
    masks: ScoredPredictions | None = None


@dataclass(frozen=True)
class FrameRecord:
    """The results of all methods on one frame.

    `seconds`: run time of `infer`; nan without `infer --timings`. `masks`: our regions.
    """

    name: str
    split: str
    seconds: float
    masks: ScoredPredictions
    rows: dict[str, RowRecord]

    def masks_of(self, row: str) -> ScoredPredictions | None:
        """Return the regions that `row` grasps: ours, those of its own file, or None."""
        return self.masks if row in (OURS, *BASELINE_ROWS) else self.rows[row].masks


def records_folder(report: Path) -> Path:
    """Return the folder of the records of the report `report`, one file per scene."""
    return report.with_suffix(".frames")


def number_key(number: float) -> str:
    """Return a threshold or a friction as a key of JSON: 0.25 is "0.25"."""
    return f"{number:g}"


def write_frame_records(path: Path, records: Sequence[FrameRecord], stamp: Stamp) -> None:
    """Write the records of one scene."""
    content = {
        "format_version": FORMAT_VERSION,
        "frames": [finite_json(asdict(record)) for record in records],
        "provenance": stamp.as_json(),
    }
    write_json(path, content)


def read_frame_records(path: Path) -> list[FrameRecord]:
    """Read the records of one scene.

    Raises:
        FormatError: the file was not written by `write_frame_records`.
    """
    content = read_json(path)
    with reading(path, "the record of a scene", "delete it and run `evaluate` again"):
        return [_record(entry) for entry in content["frames"]]


def _record(entry: Mapping[str, Any]) -> FrameRecord:
    """Return an entry of the file as a record; null is nan of seconds and inf of frictions."""
    seconds = math.nan if entry["seconds"] is None else entry["seconds"]
    for verdict in [verdict for row in entry["rows"].values() for verdict in row["verdicts"]]:
        if verdict["min_friction"] is None:
            verdict["min_friction"] = math.inf
    found: FrameRecord = typed(FrameRecord, {**entry, "seconds": seconds})
    return found
