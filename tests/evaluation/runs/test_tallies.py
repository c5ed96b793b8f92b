"""Tallies of records, which take a few bytes per prediction."""

import tracemalloc
import weakref
from dataclasses import replace

import numpy as np

from pipelines.evaluation.runs.records import FrameRecord, RowRecord, ScoredPredictions
from pipelines.evaluation.runs.tallies import PredictionTally, ReportTally
from pipelines.metrics.coco_masks import IOU_THRESHOLDS
from pipelines.metrics.grasp_verdicts import Verdict


def record(index: int, objects: int = 8) -> FrameRecord:
    """A frame of the size of real frames."""
    verdicts = [Verdict(i, "held", 0.5, 0.5, 0.9, 0.8) for i in range(objects)]
    confidence = [float(x) for x in np.random.default_rng(index).random(3 * objects)]
    right = [1] * len(confidence)
    planes = ScoredPredictions(objects, confidence, {k: right for k in ("0.25", "0.134", "0.067")})
    masks = ScoredPredictions(
        objects, confidence[:objects], {f"{i:g}": [1] * objects for i in IOU_THRESHOLDS}
    )
    row = RowRecord(verdicts, {"reflection": planes, "rotation": planes})
    return FrameRecord(f"f{index}", "seen", 0.1, masks, {"ours": row, "oracle": row})


def test_no_record_stays_in_memory():
    made = []

    def stream():
        for index in range(50):
            found = record(index)
            made.append(weakref.ref(found))
            assert sum(each() is not None for each in made) <= 2  # last added one, next one
            yield found

    assert ReportTally.of(stream()).rows["ours"]["all"].frames == 50


def test_a_frame_costs_a_few_kilobytes():
    tracemalloc.start()
    tally = ReportTally.of(record(index) for index in range(50))
    before = tracemalloc.get_traced_memory()[0]
    for index in range(400):
        tally.add(record(index))
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown / 400 < 6000


def test_a_first_frame_that_waits_for_compiled_loops_does_not_slow_the_others():
    seconds = (60.0, 0.3, 0.4, np.nan, 0.3)
    tally = ReportTally.of(replace(record(i, 1), seconds=each) for i, each in enumerate(seconds))
    assert tally.seconds_per_frame == 0.35
    assert ReportTally().seconds_per_frame is None


def test_ignored_predictions_are_not_pooled():
    tally = PredictionTally()
    tally.add(ScoredPredictions(2, [0.9, 0.8, 0.7], {"a": [1, -1, 0]}))
    tally.add(ScoredPredictions(1))
    confidence, correct, num_truth = tally.pooled("a")
    assert confidence.tolist() == [0.9, 0.7]
    assert correct.tolist() == [True, False]
    assert num_truth == 3
