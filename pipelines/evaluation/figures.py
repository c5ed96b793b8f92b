"""The figures of `report.json` from frame records: means over objects, average precisions.

Every visible object counts once a frame; an object without a grasp has quality and antipodal
score 0. Beside each mean stands the mean over the objects that did get a grasp, `..._predicted`,
which is how the paper counts.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from pipelines.evaluation.records import FrameRecord, JudgedPredictions, RowRecord, threshold_key
from pipelines.metrics.average_precision import average_precision, coco_average_precision
from pipelines.metrics.grasp_verdicts import REASONS, Verdict
from pipelines.metrics.symmetry_matching import CORRECT, IGNORED, KINDS

ROWS = ("ours", "oracle", "planar", "random")
TEST_SPLITS = ("seen", "similar", "novel")
WITHOUT_GRASP = ("no region", "no grasp")

Figures = dict[str, Any]


def report_rows(
    records: Sequence[FrameRecord], thresholds: Sequence[float], sphere_threshold: float
) -> dict[str, dict[str, Figures]]:
    """Return FIGURES by row and split: seen, similar, novel, all; train where it was evaluated.

    `thresholds`: of the dense symmetry error, the first one is the reported one, the others are
    the stricter ones beside it. `sphere_threshold`: metres.
    """
    present = {record.split for record in records}
    splits = [*(["train"] if "train" in present else []), *TEST_SPLITS, "all"]
    rows = [row for row in ROWS if any(row in record.rows for record in records)]
    return {
        row: {
            split: frame_figures(
                [r for r in records if split in ("all", r.split)], row, thresholds, sphere_threshold
            )
            for split in splits
        }
        for row in rows
    }


def frame_figures(
    records: Sequence[FrameRecord],
    row: str,
    thresholds: Sequence[float],
    sphere_threshold: float,
) -> Figures:
    """Return FIGURES of one row over `records`; what has no truth to find is None."""
    found = [record.rows[row] for record in records if row in record.rows]
    verdicts = [verdict for frame in found for verdict in frame.verdicts]
    reasons = Counter(verdict.reason for verdict in verdicts)
    reported, *stricter = thresholds
    return {
        **_means(verdicts, ""),
        **_means([v for v in verdicts if v.reason not in WITHOUT_GRASP], "_predicted"),
        "symmetry_ap": _symmetry_ap(found, reported, sphere_threshold),
        "symmetry_ap_strict": {
            threshold_key(threshold): _symmetry_ap(found, threshold, sphere_threshold)
            for threshold in stricter
        },
        "mask_ap50": _mask_ap(record.masks for record in records),
        "frames": len(found),
        "objects": len(verdicts),
        "reasons": {reason: reasons[reason] for reason in REASONS if reasons[reason]},
    }


def _means(verdicts: Sequence[Verdict], suffix: str) -> dict[str, float | None]:
    return {
        f"grasp_quality{suffix}": _mean([v.quality for v in verdicts]),
        f"antipodal_score{suffix}": _mean([v.antipodal for v in verdicts]),
        f"antipodal_score_region{suffix}": _mean([v.antipodal_region for v in verdicts]),
    }


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _symmetry_ap(
    frames: Sequence[RowRecord], threshold: float, sphere_threshold: float
) -> dict[str, float | None]:
    """Return all-point AP by kind; None where no truth, or where a method predicts none."""
    key = {kind: sphere_threshold if kind == "sphere" else threshold for kind in KINDS}
    precisions = {}
    for kind in KINDS:
        judged = [frame.symmetries[kind] for frame in frames if kind in frame.symmetries]
        precisions[kind] = _defined(average_precision(*_pooled(judged, threshold_key(key[kind]))))
    return precisions


def _mask_ap(judged: Iterable[JudgedPredictions]) -> float | None:
    pooled = list(judged)
    keys = {key for entry in pooled for key in entry.verdicts}
    return _defined(coco_average_precision(*_pooled(pooled, next(iter(keys), ""))))


def _pooled(judged: Sequence[JudgedPredictions], key: str) -> tuple[list[float], list[bool], int]:
    """Return confidences, verdicts and the number of truths of all frames together."""
    pairs = [
        (confidence, verdict == CORRECT)
        for entry in judged
        for confidence, verdict in zip(entry.confidence, entry.verdicts.get(key, []), strict=True)
        if verdict != IGNORED
    ]
    truths = sum(entry.num_truth for entry in judged)
    return [confidence for confidence, _ in pairs], [right for _, right in pairs], truths


def _defined(value: float) -> float | None:
    return None if math.isnan(value) else value
