"""Figures and tables of GraspNet's protocol: AP by camera and split, outcomes of the grasps.

A frame without a file counts as a frame without grasps, so that leaving out hard frames gains
nothing; `ap_present` is the mean over the frames with a file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Array
from pipelines.dataset.graspnet.graspnet_layout import SPLITS, split_or_none
from pipelines.evaluation.graspnet.dump_verdicts import DUMP_STATUSES
from pipelines.evaluation.reports.tables import Table
from pipelines.evaluation.runs.tallies import ALL
from pipelines.metrics.graspnet.graspnet_ap import AP_FIGURES, AP_FRICTIONS, RANKS, ap_figures
from pipelines.metrics.graspnet.graspnet_frames import DUMP_REASONS

DumpFigures = dict[str, Any]

TRAIN = "train"


@dataclass
class DumpTotals:
    """Sums over scenes that give every figure; scenes are added one by one."""

    scenes: int = 0
    frames: int = 0
    absent: int = 0  # frames without a readable file
    rows: int = 0
    left_out: int = 0
    straightened: int = 0
    accuracy: Array = field(default_factory=lambda: np.zeros((RANKS, len(AP_FRICTIONS))))
    reasons: NDArray[np.int64] = field(
        default_factory=lambda: np.zeros(len(DUMP_REASONS), np.int64)
    )
    reachable: Array = field(default_factory=lambda: np.zeros(RANKS))  # if all grasps held

    def add(self, verdicts: Mapping[str, NDArray[Any]]) -> None:
        """Add the verdicts on one scene, as `read_dump_verdicts` returns them."""
        self.scenes += 1
        self.frames += len(verdicts["frame_id"])
        self.absent += int((verdicts["status"] != DUMP_STATUSES.index("ok")).sum())
        self.rows += int(verdicts["rows"].sum())
        self.left_out += int(verdicts["left_out"].sum())
        self.straightened += int(verdicts["straightened"].sum())
        self.accuracy += verdicts["accuracy"].sum(axis=0)
        count = (verdicts["reason"] >= 0).sum(axis=1)[:, None]
        self.reachable += np.minimum(count / np.arange(1, RANKS + 1), 1.0).sum(axis=0)
        scored = verdicts["reason"][verdicts["reason"] >= 0]
        self.reasons += np.bincount(scored, minlength=len(DUMP_REASONS))

    def figures(self) -> DumpFigures:
        """Return FIGURES; a figure is None without frames."""
        by_friction = self._mean(self.frames)
        present = self._mean(self.frames - self.absent)
        return {
            **(dict.fromkeys(AP_FIGURES) if by_friction is None else ap_figures(by_friction)),
            "ap_present": None if present is None else ap_figures(present)["ap"],
            "ap_by_friction": None
            if by_friction is None
            else {f"{mu:g}": ap for mu, ap in zip(AP_FRICTIONS, by_friction, strict=True)},
            "scenes": self.scenes,
            "frames": self.frames,
            "frames_absent": self.absent,
            "rows": self.rows,
            "rows_left_out": self.left_out,
            "rows_straightened": self.straightened,
            "reasons": {r: int(n) for r, n in zip(DUMP_REASONS, self.reasons, strict=True) if n},
        }

    def by_rank(self) -> DumpFigures:
        """Return the mean accuracy at k = 1 to 50: by friction, over frictions, and reachable."""
        accuracy = self.accuracy / max(self.frames, 1)
        held = {
            f"{mu:g}": column.tolist() for mu, column in zip(AP_FRICTIONS, accuracy.T, strict=True)
        }
        reachable = (self.reachable / max(self.frames, 1)).tolist()
        return {"held": held, "mean": accuracy.mean(axis=1).tolist(), "reachable": reachable}

    def _mean(self, frames: int) -> list[float] | None:
        """Return AP at each friction over `frames` frames; None for 0."""
        return None if frames == 0 else (self.accuracy.mean(axis=0) / frames).tolist()


@dataclass
class DumpTally:
    """Totals by camera and split, and the figures of each scene."""

    totals: dict[str, dict[str, DumpTotals]] = field(default_factory=dict)
    scenes: dict[str, DumpFigures] = field(default_factory=dict)

    def add(
        self, name: str, camera: str, scene_id: int, verdicts: Mapping[str, NDArray[Any]]
    ) -> None:
        """Add the verdicts on one scene, as `read_dump_verdicts` returns them."""
        splits = self.totals.setdefault(camera, {split: DumpTotals() for split in (*SPLITS, ALL)})
        own, total = split_or_none(scene_id), DumpTotals()
        for each in (total, *(splits[split] for split in (own, ALL) if split)):
            each.add(verdicts)
        self.scenes[name] = {"split": own, **total.figures()}

    def rows(self) -> dict[str, dict[str, DumpFigures]]:
        """Return FIGURES by camera and split; the split train only if it was dumped."""
        return {
            camera: {name: t.figures() for name, t in splits.items() if name != TRAIN or t.frames}
            for camera, splits in sorted(self.totals.items())
        }

    def accuracy(self) -> dict[str, dict[str, DumpFigures]]:
        """Return accuracy by rank for each camera and split: splits with frames, and `all`."""
        return {
            camera: {n: t.by_rank() for n, t in splits.items() if n == ALL or t.frames}
            for camera, splits in sorted(self.totals.items())
        }


def scene_table(scenes: Mapping[str, DumpFigures]) -> Table:
    """Return a table with one row per scene."""
    return Table(
        "Average precision and outcomes of the ranked grasps, percent",
        ("scene", "split", "AP", "AP 0.8", "AP 0.4", *DUMP_REASONS, "grasps", "frames", "absent"),
        tuple(
            (
                *(name, f["split"], *(percent(f[key]) for key in AP_FIGURES)),
                *(*_shares(f["reasons"]), str(f["frames"]), str(f["frames_absent"])),
            )
            for name, f in scenes.items()
        ),
        names=2,
    )


def dump_tables(rows: Mapping[str, Mapping[str, DumpFigures]]) -> list[Table]:
    """Return the tables of a report on a dump."""
    cells = [(row, split, f) for row, splits in rows.items() for split, f in splits.items()]
    cells = [cell for cell in cells if cell[2]["frames"]]
    header = ("camera", "split", "AP", "AP 0.8", "AP 0.4", "AP present", "scenes", "frames")
    names = (*AP_FIGURES, "ap_present")
    precision = Table(
        "Average precision by GraspNet's protocol, percent",
        (*header, "absent"),
        tuple(
            (
                *(row, split, *(percent(f[name]) for name in names)),
                *(str(f[name]) for name in ("scenes", "frames", "frames_absent")),
            )
            for row, split, f in cells
        ),
        note="Frames without a readable file are absent and count 0; AP present leaves them out.",
        names=2,
    )
    outcomes = Table(
        "Outcomes of the ranked grasps, percent",
        ("camera", "split", *DUMP_REASONS, "grasps"),
        tuple((row, split, *_shares(f["reasons"])) for row, split, f in cells),
        names=2,
    )
    return [precision, outcomes]


def _shares(reasons: Mapping[str, int]) -> list[str]:
    total = sum(reasons.values())
    shares = [percent(reasons.get(r, 0) / total if total else None) for r in DUMP_REASONS]
    return [*shares, str(total)]


def percent(share: float | None) -> str:
    """Return a share in percent, two decimals; a dash for None."""
    return "-" if share is None else f"{100.0 * share:.2f}"
