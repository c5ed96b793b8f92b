"""Figures and tables of GraspNet's protocol: AP by camera and split, what became of the grasps.

A frame without a file counts as a frame without grasps, so that nobody gains by leaving out the
hard ones; the mean over the frames that are there stands beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.evaluation.tables import Table
from pipelines.formats.dump_verdicts import STATUSES
from pipelines.metrics.graspnet_ap import FRICTIONS, RANKS
from pipelines.metrics.graspnet_frames import REASONS

Array = NDArray[np.float64]
Figures = dict[str, Any]

SHOWN = {"ap_0.8": FRICTIONS.index(0.8), "ap_0.4": FRICTIONS.index(0.4)}


@dataclass
class DumpTotals:
    """Sums over scenes, from which every figure follows; scenes are added one by one."""

    scenes: int = 0
    frames: int = 0
    absent: int = 0  # frames without a readable file
    rows: int = 0
    left_out: int = 0
    straightened: int = 0
    accuracy: Array = field(default_factory=lambda: np.zeros((RANKS, len(FRICTIONS))))
    reasons: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(REASONS), np.int64))

    def add(self, verdicts: Mapping[str, NDArray[Any]]) -> None:
        """Add the verdicts on one scene, as `formats.dump_verdicts` reads them."""
        self.scenes += 1
        self.frames += len(verdicts["frame_id"])
        self.absent += int((verdicts["status"] != STATUSES.index("ok")).sum())
        self.rows += int(verdicts["rows"].sum())
        self.left_out += int(verdicts["left_out"].sum())
        self.straightened += int(verdicts["straightened"].sum())
        self.accuracy += verdicts["accuracy"].sum(axis=0)
        judged = verdicts["reason"][verdicts["reason"] >= 0]
        self.reasons += np.bincount(judged, minlength=len(REASONS))

    def figures(self) -> Figures:
        """Return FIGURES; None where there are no frames."""
        by_friction = self._mean(self.frames)
        present = self._mean(self.frames - self.absent)
        return {
            "ap": _mean_or_none(by_friction),
            **{name: None if by_friction is None else by_friction[i] for name, i in SHOWN.items()},
            "ap_present": _mean_or_none(present),
            "ap_by_friction": None
            if by_friction is None
            else {f"{mu:g}": ap for mu, ap in zip(FRICTIONS, by_friction, strict=True)},
            "scenes": self.scenes,
            "frames": self.frames,
            "frames_absent": self.absent,
            "rows": self.rows,
            "rows_left_out": self.left_out,
            "rows_straightened": self.straightened,
            "reasons": {r: int(n) for r, n in zip(REASONS, self.reasons, strict=True) if n},
        }

    def _mean(self, frames: int) -> list[float] | None:
        """Return AP at each friction over so many frames."""
        return None if frames == 0 else (self.accuracy.mean(axis=0) / frames).tolist()


def dump_tables(rows: Mapping[str, Mapping[str, Figures]]) -> list[Table]:
    """Return the tables of a report on a dump."""
    cells = [(row, split, f) for row, splits in rows.items() for split, f in splits.items()]
    cells = [cell for cell in cells if cell[2]["frames"]]
    header = ("camera", "split", "AP", "AP 0.8", "AP 0.4", "AP present", "scenes", "frames")
    names = ("ap", "ap_0.8", "ap_0.4", "ap_present")
    precision = Table(
        "Average precision by GraspNet's protocol, percent",
        (*header, "absent"),
        tuple(
            (
                *(row, split, *(_percent(f[name]) for name in names)),
                *(str(f[name]) for name in ("scenes", "frames", "frames_absent")),
            )
            for row, split, f in cells
        ),
        note="Frames without a readable file are absent and count 0; AP present leaves them out.",
        names=2,
    )
    fates = Table(
        "What became of the ranked grasps, percent",
        ("camera", "split", *REASONS, "grasps"),
        tuple((row, split, *_shares(f["reasons"])) for row, split, f in cells),
        names=2,
    )
    return [precision, fates]


def _shares(reasons: Mapping[str, int]) -> list[str]:
    total = sum(reasons.values())
    shares = [_percent(reasons.get(r, 0) / total if total else None) for r in REASONS]
    return [*shares, str(total)]


def _mean_or_none(values: list[float] | None) -> float | None:
    return None if values is None else float(np.mean(values))


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.2f}"
