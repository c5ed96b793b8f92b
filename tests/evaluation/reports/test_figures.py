"""Figures from frame records whose means and precisions are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pipelines.evaluation.reports.figures import report_curves, report_rows, swept_quality
from pipelines.evaluation.runs.records import FrameRecord, RowRecord, ScoredPredictions
from pipelines.evaluation.runs.tallies import ReportTally
from pipelines.metrics.coco_masks import IOU_THRESHOLDS
from pipelines.metrics.grasp_verdicts import Verdict

THRESHOLDS = (0.25, 0.134)
SPHERE = 0.05
NO_MASKS = ScoredPredictions(0)


def judged(verdicts: list[int], num_truth: int, key: str = "0.25") -> ScoredPredictions:
    confidence = [0.9 - 0.1 * i for i in range(len(verdicts))]
    return ScoredPredictions(num_truth, confidence, {key: verdicts, "0.134": verdicts})


def frame(split: str, row: RowRecord, masks: ScoredPredictions = NO_MASKS) -> FrameRecord:
    return FrameRecord("f", split, 0.1, masks, {"ours": row})


def held(quality: float) -> Verdict:
    return Verdict(0, "held", quality, 1.0 - quality, quality, quality)


def figures(*records: FrameRecord) -> dict:
    return report_rows(ReportTally.of(records), THRESHOLDS, SPHERE)["ours"]["all"]


def test_objects_without_grasp_count_as_zero_and_are_listed_apart():
    missing = Verdict(1, "no region")
    found = figures(frame("seen", RowRecord([held(0.8), missing])))
    assert found["grasp_quality"] == pytest.approx(0.4)
    assert found["grasp_quality_predicted"] == pytest.approx(0.8)
    assert found["antipodal_score"] == pytest.approx(0.4)
    assert found["reasons"] == {"no region": 1, "held": 1}


def test_a_collision_counts_as_predicted():
    found = figures(frame("seen", RowRecord([held(0.8), Verdict(1, "collision")])))
    assert found["grasp_quality_predicted"] == pytest.approx(0.4)


def test_predictions_of_all_frames_are_ranked_together():
    planes = {"reflection": judged([1, 0], 1)}
    found = figures(
        frame("seen", RowRecord([], planes)),
        frame("novel", RowRecord([], {"reflection": judged([0, 1], 1)})),
    )
    # By confidence: right and wrong tie at 0.9, one point; then wrong and right at 0.8, another.
    assert found["symmetry_ap"]["reflection"] == pytest.approx(0.5 * 0.5 + 0.5 * 0.5)


def test_ignored_predictions_are_neither_right_nor_wrong():
    with_ignored = figures(frame("seen", RowRecord([], {"rotation": judged([-1, 1], 1)})))
    assert with_ignored["symmetry_ap"]["rotation"] == 1.0


def test_figures_without_truth_are_none():
    found = figures(frame("seen", RowRecord([], {"reflection": judged([0], 0)})))
    assert found["symmetry_ap"] == {"reflection": None, "rotation": None, "sphere": None}
    assert found["mask_ap50"] is None
    assert found["grasp_quality"] is None


def test_masks_that_are_all_found_have_average_precision_one():
    masks = ScoredPredictions(2, [0.9, 0.8], {f"{iou:g}": [1, 1] for iou in IOU_THRESHOLDS})
    found = figures(frame("seen", RowRecord([]), masks))
    assert [found[name] for name in ("mask_ap50", "mask_ap75", "mask_ap")] == [1.0, 1.0, 1.0]


def test_the_precision_of_masks_is_that_of_the_named_overlap():
    # Both are right at 0.5, the first up to 0.7, only the second at 0.75: precision 1/2 there.
    right = {iou: [1, 0] if iou < 0.75 else [0, 0] for iou in IOU_THRESHOLDS}
    right |= {0.5: [1, 1], 0.75: [0, 1]}
    masks = ScoredPredictions(2, [0.9, 0.8], {f"{iou:g}": each for iou, each in right.items()})
    found = figures(frame("seen", RowRecord([]), masks))
    half = 51 / 101  # of COCO's recalls are at most 1/2
    assert found["mask_ap50"] == pytest.approx(1.0)
    assert found["mask_ap75"] == pytest.approx(half / 2)
    assert found["mask_ap"] == pytest.approx((1.0 + 4 * half + half / 2) / 10)


def test_the_average_precision_of_masks_is_that_of_the_regions_a_row_grasps():
    ours, theirs = (ScoredPredictions(1, [0.9], {"0.5": [right]}) for right in (1, 0))
    rows = {
        "ours": RowRecord([]),
        "planar": RowRecord([]),
        "second": RowRecord([], masks=theirs),
        "gg-cnn": RowRecord([]),
    }
    one = FrameRecord("f", "seen", 0.1, ours, rows)
    found = report_rows(ReportTally.of([one, one]), THRESHOLDS, SPHERE)
    precision = {row: splits["all"]["mask_ap50"] for row, splits in found.items()}
    assert precision == {"ours": 1.0, "planar": 1.0, "second": 0.0, "gg-cnn": None}
    # An earlier version wrote the first frame, without the regions of other files.
    older = replace(one, rows={**rows, "second": RowRecord([])})
    found = report_rows(ReportTally.of([older, one]), THRESHOLDS, SPHERE)
    assert found["second"]["all"]["mask_ap50"] is None
    assert found["ours"]["all"]["mask_ap50"] == 1.0


def test_the_share_held_rises_with_friction_and_failures_are_never_held():
    verdicts = [held(0.8), held(0.5), Verdict(1, "collision", 0.0, 0.1), Verdict(2, "no region")]
    tally = ReportTally.of([frame("seen", RowRecord(verdicts))])
    curves = report_curves(tally, THRESHOLDS, SPHERE)
    share = dict(zip(curves["friction"], curves["held"]["ours"], strict=True))
    assert [share[mu] for mu in (0.15, 0.2, 0.45, 0.5, 1.0)] == [0.0, 0.25, 0.25, 0.5, 0.5]


def test_the_area_above_the_share_held_is_the_mean_quality():
    rng = np.random.default_rng(0)
    verdicts = [held(float(quality)) for quality in rng.random(2000)]
    tally = ReportTally.of([frame("seen", RowRecord(verdicts))])
    shares = report_curves(tally, THRESHOLDS, SPHERE)["held"]["ours"]
    mean = figures(frame("seen", RowRecord(verdicts)))["grasp_quality"]
    assert np.trapezoid(shares, dx=0.05) == pytest.approx(mean, abs=0.01)


def test_the_precision_of_a_curve_is_the_best_at_that_recall_or_beyond():
    planes = {"reflection": judged([1, 0, 1], 4)}
    tally = ReportTally.of([frame("seen", RowRecord([], planes))])
    curves = report_curves(tally, THRESHOLDS, SPHERE)
    found = dict(
        zip(curves["recall"], curves["symmetry"]["ours"]["reflection"]["0.25"], strict=True)
    )
    assert [found[r] for r in (0.0, 0.24, 0.26, 0.5, 0.52)] == [1.0, 1.0, 0.6667, 0.6667, 0.0]


def test_the_row_all_holds_all_splits_and_train_is_shown_only_if_evaluated():
    records = [frame("seen", RowRecord([held(1.0)])), frame("novel", RowRecord([held(0.5)]))]
    rows = report_rows(ReportTally.of(records), THRESHOLDS, SPHERE)
    assert list(rows) == ["ours"]
    assert list(rows["ours"]) == ["seen", "similar", "novel", "all"]
    assert rows["ours"]["all"]["grasp_quality"] == pytest.approx(0.75)
    train = ReportTally.of([frame("train", RowRecord([]))])
    trained = report_rows(train, THRESHOLDS, SPHERE)
    assert "train" in trained["ours"]


def test_friction_without_force_closure_stays_infinite_in_memory():
    assert math.isinf(Verdict(0, "no contact").min_friction)


def test_a_sweep_finds_the_next_friction_at_which_a_grasp_holds():
    found = swept_quality([0.0, 0.05, 0.1, 0.3, 0.38, 0.7, 0.999, 1.0])
    np.testing.assert_allclose(found, [0.0, 0.0, 0.1, 0.3, 0.3, 0.7, 0.9, 0.9])
