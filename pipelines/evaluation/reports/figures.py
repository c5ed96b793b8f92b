"""The figures of `report.json` from the tally of frame records: means, precisions, curves.

FIGURES are the entries of one row and split, as `docs/reference/formats.md` lists them. Every
visible object counts once per frame; an object without a grasp has quality and antipodal score 0.
Each mean has a second one, `..._predicted`, over the objects with a grasp, as in the paper.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Mask
from pipelines.evaluation.rows import ordered_rows
from pipelines.evaluation.runs.records import number_key
from pipelines.evaluation.runs.tallies import ALL, ReportTally, RowTally
from pipelines.geometry.symmetry import SYMMETRY_KINDS
from pipelines.metrics.average_precision import average_precision, interpolated_precision
from pipelines.metrics.coco_masks import IOU_THRESHOLDS, coco_average_precision
from pipelines.metrics.grasp_verdicts import REASONS
from pipelines.metrics.graspnet.graspnet_ap import AP_FIGURES, ap_figures

TEST_SPLITS = ("seen", "similar", "novel")
CURVE_FRICTIONS = np.round(np.arange(0.0, 1.001, 0.05), 2)  # for the share of objects held
SWEEP_STEP = 0.1  # of the friction sweep of PointNetGPD, which the paper cites
ROUNDING = 1e-9  # of a number of steps
CURVE_RECALLS = np.round(np.linspace(0.0, 1.0, 51), 2)

Figures = dict[str, Any]


def report_rows(
    tally: ReportTally, thresholds: Sequence[float], sphere_threshold: float
) -> dict[str, dict[str, Figures]]:
    """Return FIGURES by row and split: seen, similar, novel, all; train if it was evaluated.

    `thresholds`: of the dense symmetry error; the first is the reported threshold, the others,
    stricter by default, are for comparison. `sphere_threshold`: metres.
    """
    return {
        row: {
            split: split_figures(tally.rows[row][split], thresholds, sphere_threshold)
            for split in _splits(tally)
        }
        for row in ordered_rows(tally.rows)
    }


def split_figures(row: RowTally, thresholds: Sequence[float], sphere_threshold: float) -> Figures:
    """Return FIGURES of one row in one split; a figure without any truth is None."""
    reported, *stricter = thresholds
    return {
        **_means(row, np.ones(len(row.predicted), np.bool_), ""),
        **_means(row, np.array(row.predicted, np.bool_), "_predicted"),
        "symmetry_ap": _symmetry_ap(row, reported, sphere_threshold),
        "symmetry_ap_strict": {
            number_key(threshold): _symmetry_ap(row, threshold, sphere_threshold)
            for threshold in stricter
        },
        **_mask_ap(row),
        **_graspnet_ap(row),
        "frames": row.frames,
        "objects": len(row.predicted),
        "reasons": {reason: row.reasons[reason] for reason in REASONS if row.reasons[reason]},
    }


def report_curves(
    tally: ReportTally, thresholds: Sequence[float], sphere_threshold: float
) -> dict[str, Any]:
    """Return the curves of a report, over all frames.

    `held`: by row, the share of objects held at each of `friction`. `symmetry`: by row, kind and
    threshold, the best precision at each of `recall` or beyond.
    """
    rows = {row: tally.rows[row][ALL] for row in ordered_rows(tally.rows)}
    symmetry = {
        row: {
            kind: _curves_of(found, kind, thresholds, sphere_threshold) for kind in SYMMETRY_KINDS
        }
        for row, found in rows.items()
    }
    return {
        "friction": CURVE_FRICTIONS.tolist(),
        "held": {row: _held_share(found) for row, found in rows.items() if found.predicted},
        "recall": CURVE_RECALLS.tolist(),
        "symmetry": {row: curves for row, curves in symmetry.items() if any(curves.values())},
    }


def _splits(tally: ReportTally) -> list[str]:
    has_train = any("train" in splits for splits in tally.rows.values())
    return [*(["train"] if has_train else []), *TEST_SPLITS, ALL]


def _means(row: RowTally, counted: Mask, suffix: str) -> dict[str, float | None]:
    return {
        f"grasp_quality{suffix}": _mean(row.quality, counted),
        f"grasp_quality_swept{suffix}": _mean(swept_quality(row.quality), counted),
        f"antipodal_score{suffix}": _mean(row.antipodal, counted),
        f"antipodal_score_region{suffix}": _mean(row.antipodal_region, counted),
    }


def swept_quality(quality: ArrayLike) -> Array:
    """Return (n,) qualities by a sweep of the friction in steps of `SWEEP_STEP`: rounded down.

    A grasp of quality 1 - mu holds at the next friction of the sweep, which begins at one step.
    """
    steps = np.floor(np.asarray(quality, np.float64) / SWEEP_STEP + ROUNDING)
    return np.asarray(np.minimum(steps * SWEEP_STEP, 1.0 - SWEEP_STEP))


def _mean(values: ArrayLike, counted: Mask) -> float | None:
    return float(np.mean(np.asarray(values)[counted])) if counted.any() else None


def _key(kind: str, threshold: float, sphere_threshold: float) -> str:
    return number_key(sphere_threshold if kind == "sphere" else threshold)


def _symmetry_ap(
    row: RowTally, threshold: float, sphere_threshold: float
) -> dict[str, float | None]:
    """Return all-point AP by kind; None without truth, and for methods without symmetries."""
    return {
        kind: _defined(
            average_precision(*row.symmetries[kind].pooled(_key(kind, threshold, sphere_threshold)))
        )
        for kind in SYMMETRY_KINDS
    }


def _curves_of(
    row: RowTally, kind: str, thresholds: Sequence[float], sphere_threshold: float
) -> dict[str, list[float]]:
    scored = row.symmetries[kind]
    keys = dict.fromkeys(_key(kind, threshold, sphere_threshold) for threshold in thresholds)
    if not scored.num_truth:
        return {}
    return {
        key: interpolated_precision(*scored.pooled(key), CURVE_RECALLS).round(4).tolist()
        for key in keys
    }


def _held_share(row: RowTally) -> list[float]:
    friction = np.sort(np.array(row.held_friction))
    held = np.searchsorted(friction, CURVE_FRICTIONS, side="right")
    return [float(share) for share in held / len(friction)]


def _graspnet_ap(row: RowTally) -> dict[str, float | None]:
    """Return AP by GraspNet's protocol, over all frictions and at two single frictions."""
    if not row.with_accuracy:
        return dict.fromkeys(AP_FIGURES)
    return dict(ap_figures(row.accuracy / row.with_accuracy))


def _mask_ap(row: RowTally) -> dict[str, float | None]:
    """Return COCO's AP at IoU 0.5, at IoU 0.75, and its mean over 0.5 to 0.95.

    None unless the regions of all frames are known: a method may have none, and older records lack
    those of other files.
    """
    masks = row.masks
    if row.with_masks < row.frames:
        return dict.fromkeys(("mask_ap50", "mask_ap75", "mask_ap"))
    pooled = [masks.pooled(number_key(threshold)) for threshold in IOU_THRESHOLDS]
    confidence = pooled[0][0]
    # Records of frames without predictions may lack the thresholds.
    correct = [right if len(right) else np.zeros(len(confidence)) for _, right, _ in pooled]
    precision = coco_average_precision(confidence, np.array(correct), masks.num_truth)
    return {
        "mask_ap50": _defined(float(precision[0])),
        "mask_ap75": _defined(float(precision[IOU_THRESHOLDS.index(0.75)])),
        "mask_ap": _defined(float(precision.mean())),
    }


def _defined(value: float) -> float | None:
    return None if math.isnan(value) else value
